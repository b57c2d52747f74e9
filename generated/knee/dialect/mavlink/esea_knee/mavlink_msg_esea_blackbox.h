#pragma once
// MESSAGE ESEA_BLACKBOX PACKING

#include <stdint.h>

#define MAVLINK_MSG_ID_ESEA_BLACKBOX 42667


typedef struct __mavlink_esea_blackbox_t {
 uint32_t first; /*<  Number of the first record here, the oldest is 0.*/
 uint32_t count; /*<  Records that there are; 0: it is not frozen.*/
 uint32_t fault; /*<  Why it was frozen.*/
 uint32_t tick; /*<  Base tick at which it was frozen.*/
 uint8_t records; /*<  Records here. To the board: 255 releases it.*/
 uint8_t size; /*<  Bytes of a record.*/
 uint8_t whole; /*<  Bit by record: whether its check holds.*/
 uint8_t data[224]; /*<  Records as they lie in memory.*/
} mavlink_esea_blackbox_t;

#define MAVLINK_MSG_ID_ESEA_BLACKBOX_LEN 243
#define MAVLINK_MSG_ID_ESEA_BLACKBOX_MIN_LEN 243
#define MAVLINK_MSG_ID_42667_LEN 243
#define MAVLINK_MSG_ID_42667_MIN_LEN 243

#define MAVLINK_MSG_ID_ESEA_BLACKBOX_CRC 80
#define MAVLINK_MSG_ID_42667_CRC 80

#define MAVLINK_MSG_ESEA_BLACKBOX_FIELD_DATA_LEN 224

#if MAVLINK_COMMAND_24BIT
#define MAVLINK_MESSAGE_INFO_ESEA_BLACKBOX { \
    42667, \
    "ESEA_BLACKBOX", \
    8, \
    {  { "first", NULL, MAVLINK_TYPE_UINT32_T, 0, 0, offsetof(mavlink_esea_blackbox_t, first) }, \
         { "count", NULL, MAVLINK_TYPE_UINT32_T, 0, 4, offsetof(mavlink_esea_blackbox_t, count) }, \
         { "fault", NULL, MAVLINK_TYPE_UINT32_T, 0, 8, offsetof(mavlink_esea_blackbox_t, fault) }, \
         { "tick", NULL, MAVLINK_TYPE_UINT32_T, 0, 12, offsetof(mavlink_esea_blackbox_t, tick) }, \
         { "records", NULL, MAVLINK_TYPE_UINT8_T, 0, 16, offsetof(mavlink_esea_blackbox_t, records) }, \
         { "size", NULL, MAVLINK_TYPE_UINT8_T, 0, 17, offsetof(mavlink_esea_blackbox_t, size) }, \
         { "whole", NULL, MAVLINK_TYPE_UINT8_T, 0, 18, offsetof(mavlink_esea_blackbox_t, whole) }, \
         { "data", NULL, MAVLINK_TYPE_UINT8_T, 224, 19, offsetof(mavlink_esea_blackbox_t, data) }, \
         } \
}
#else
#define MAVLINK_MESSAGE_INFO_ESEA_BLACKBOX { \
    "ESEA_BLACKBOX", \
    8, \
    {  { "first", NULL, MAVLINK_TYPE_UINT32_T, 0, 0, offsetof(mavlink_esea_blackbox_t, first) }, \
         { "count", NULL, MAVLINK_TYPE_UINT32_T, 0, 4, offsetof(mavlink_esea_blackbox_t, count) }, \
         { "fault", NULL, MAVLINK_TYPE_UINT32_T, 0, 8, offsetof(mavlink_esea_blackbox_t, fault) }, \
         { "tick", NULL, MAVLINK_TYPE_UINT32_T, 0, 12, offsetof(mavlink_esea_blackbox_t, tick) }, \
         { "records", NULL, MAVLINK_TYPE_UINT8_T, 0, 16, offsetof(mavlink_esea_blackbox_t, records) }, \
         { "size", NULL, MAVLINK_TYPE_UINT8_T, 0, 17, offsetof(mavlink_esea_blackbox_t, size) }, \
         { "whole", NULL, MAVLINK_TYPE_UINT8_T, 0, 18, offsetof(mavlink_esea_blackbox_t, whole) }, \
         { "data", NULL, MAVLINK_TYPE_UINT8_T, 224, 19, offsetof(mavlink_esea_blackbox_t, data) }, \
         } \
}
#endif

/**
 * @brief Pack a esea_blackbox message
 * @param system_id ID of this system
 * @param component_id ID of this component (e.g. 200 for IMU)
 * @param msg The MAVLink message to compress the data into
 *
 * @param first  Number of the first record here, the oldest is 0.
 * @param count  Records that there are; 0: it is not frozen.
 * @param fault  Why it was frozen.
 * @param tick  Base tick at which it was frozen.
 * @param records  Records here. To the board: 255 releases it.
 * @param size  Bytes of a record.
 * @param whole  Bit by record: whether its check holds.
 * @param data  Records as they lie in memory.
 * @return length of the message in bytes (excluding serial stream start sign)
 */
static inline uint16_t mavlink_msg_esea_blackbox_pack(uint8_t system_id, uint8_t component_id, mavlink_message_t* msg,
                               uint32_t first, uint32_t count, uint32_t fault, uint32_t tick, uint8_t records, uint8_t size, uint8_t whole, const uint8_t *data)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    char buf[MAVLINK_MSG_ID_ESEA_BLACKBOX_LEN];
    _mav_put_uint32_t(buf, 0, first);
    _mav_put_uint32_t(buf, 4, count);
    _mav_put_uint32_t(buf, 8, fault);
    _mav_put_uint32_t(buf, 12, tick);
    _mav_put_uint8_t(buf, 16, records);
    _mav_put_uint8_t(buf, 17, size);
    _mav_put_uint8_t(buf, 18, whole);
    _mav_put_uint8_t_array(buf, 19, data, 224);
        memcpy(_MAV_PAYLOAD_NON_CONST(msg), buf, MAVLINK_MSG_ID_ESEA_BLACKBOX_LEN);
#else
    mavlink_esea_blackbox_t packet;
    packet.first = first;
    packet.count = count;
    packet.fault = fault;
    packet.tick = tick;
    packet.records = records;
    packet.size = size;
    packet.whole = whole;
    mav_array_memcpy(packet.data, data, sizeof(uint8_t)*224);
        memcpy(_MAV_PAYLOAD_NON_CONST(msg), &packet, MAVLINK_MSG_ID_ESEA_BLACKBOX_LEN);
#endif

    msg->msgid = MAVLINK_MSG_ID_ESEA_BLACKBOX;
    return mavlink_finalize_message(msg, system_id, component_id, MAVLINK_MSG_ID_ESEA_BLACKBOX_MIN_LEN, MAVLINK_MSG_ID_ESEA_BLACKBOX_LEN, MAVLINK_MSG_ID_ESEA_BLACKBOX_CRC);
}

/**
 * @brief Pack a esea_blackbox message
 * @param system_id ID of this system
 * @param component_id ID of this component (e.g. 200 for IMU)
 * @param status MAVLink status structure
 * @param msg The MAVLink message to compress the data into
 *
 * @param first  Number of the first record here, the oldest is 0.
 * @param count  Records that there are; 0: it is not frozen.
 * @param fault  Why it was frozen.
 * @param tick  Base tick at which it was frozen.
 * @param records  Records here. To the board: 255 releases it.
 * @param size  Bytes of a record.
 * @param whole  Bit by record: whether its check holds.
 * @param data  Records as they lie in memory.
 * @return length of the message in bytes (excluding serial stream start sign)
 */
static inline uint16_t mavlink_msg_esea_blackbox_pack_status(uint8_t system_id, uint8_t component_id, mavlink_status_t *_status, mavlink_message_t* msg,
                               uint32_t first, uint32_t count, uint32_t fault, uint32_t tick, uint8_t records, uint8_t size, uint8_t whole, const uint8_t *data)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    char buf[MAVLINK_MSG_ID_ESEA_BLACKBOX_LEN];
    _mav_put_uint32_t(buf, 0, first);
    _mav_put_uint32_t(buf, 4, count);
    _mav_put_uint32_t(buf, 8, fault);
    _mav_put_uint32_t(buf, 12, tick);
    _mav_put_uint8_t(buf, 16, records);
    _mav_put_uint8_t(buf, 17, size);
    _mav_put_uint8_t(buf, 18, whole);
    _mav_put_uint8_t_array(buf, 19, data, 224);
        memcpy(_MAV_PAYLOAD_NON_CONST(msg), buf, MAVLINK_MSG_ID_ESEA_BLACKBOX_LEN);
#else
    mavlink_esea_blackbox_t packet;
    packet.first = first;
    packet.count = count;
    packet.fault = fault;
    packet.tick = tick;
    packet.records = records;
    packet.size = size;
    packet.whole = whole;
    mav_array_memcpy(packet.data, data, sizeof(uint8_t)*224);
        memcpy(_MAV_PAYLOAD_NON_CONST(msg), &packet, MAVLINK_MSG_ID_ESEA_BLACKBOX_LEN);
#endif

    msg->msgid = MAVLINK_MSG_ID_ESEA_BLACKBOX;
#if MAVLINK_CRC_EXTRA
    return mavlink_finalize_message_buffer(msg, system_id, component_id, _status, MAVLINK_MSG_ID_ESEA_BLACKBOX_MIN_LEN, MAVLINK_MSG_ID_ESEA_BLACKBOX_LEN, MAVLINK_MSG_ID_ESEA_BLACKBOX_CRC);
#else
    return mavlink_finalize_message_buffer(msg, system_id, component_id, _status, MAVLINK_MSG_ID_ESEA_BLACKBOX_MIN_LEN, MAVLINK_MSG_ID_ESEA_BLACKBOX_LEN);
#endif
}

/**
 * @brief Pack a esea_blackbox message on a channel
 * @param system_id ID of this system
 * @param component_id ID of this component (e.g. 200 for IMU)
 * @param chan The MAVLink channel this message will be sent over
 * @param msg The MAVLink message to compress the data into
 * @param first  Number of the first record here, the oldest is 0.
 * @param count  Records that there are; 0: it is not frozen.
 * @param fault  Why it was frozen.
 * @param tick  Base tick at which it was frozen.
 * @param records  Records here. To the board: 255 releases it.
 * @param size  Bytes of a record.
 * @param whole  Bit by record: whether its check holds.
 * @param data  Records as they lie in memory.
 * @return length of the message in bytes (excluding serial stream start sign)
 */
static inline uint16_t mavlink_msg_esea_blackbox_pack_chan(uint8_t system_id, uint8_t component_id, uint8_t chan,
                               mavlink_message_t* msg,
                                   uint32_t first,uint32_t count,uint32_t fault,uint32_t tick,uint8_t records,uint8_t size,uint8_t whole,const uint8_t *data)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    char buf[MAVLINK_MSG_ID_ESEA_BLACKBOX_LEN];
    _mav_put_uint32_t(buf, 0, first);
    _mav_put_uint32_t(buf, 4, count);
    _mav_put_uint32_t(buf, 8, fault);
    _mav_put_uint32_t(buf, 12, tick);
    _mav_put_uint8_t(buf, 16, records);
    _mav_put_uint8_t(buf, 17, size);
    _mav_put_uint8_t(buf, 18, whole);
    _mav_put_uint8_t_array(buf, 19, data, 224);
        memcpy(_MAV_PAYLOAD_NON_CONST(msg), buf, MAVLINK_MSG_ID_ESEA_BLACKBOX_LEN);
#else
    mavlink_esea_blackbox_t packet;
    packet.first = first;
    packet.count = count;
    packet.fault = fault;
    packet.tick = tick;
    packet.records = records;
    packet.size = size;
    packet.whole = whole;
    mav_array_memcpy(packet.data, data, sizeof(uint8_t)*224);
        memcpy(_MAV_PAYLOAD_NON_CONST(msg), &packet, MAVLINK_MSG_ID_ESEA_BLACKBOX_LEN);
#endif

    msg->msgid = MAVLINK_MSG_ID_ESEA_BLACKBOX;
    return mavlink_finalize_message_chan(msg, system_id, component_id, chan, MAVLINK_MSG_ID_ESEA_BLACKBOX_MIN_LEN, MAVLINK_MSG_ID_ESEA_BLACKBOX_LEN, MAVLINK_MSG_ID_ESEA_BLACKBOX_CRC);
}

/**
 * @brief Encode a esea_blackbox struct
 *
 * @param system_id ID of this system
 * @param component_id ID of this component (e.g. 200 for IMU)
 * @param msg The MAVLink message to compress the data into
 * @param esea_blackbox C-struct to read the message contents from
 */
static inline uint16_t mavlink_msg_esea_blackbox_encode(uint8_t system_id, uint8_t component_id, mavlink_message_t* msg, const mavlink_esea_blackbox_t* esea_blackbox)
{
    return mavlink_msg_esea_blackbox_pack(system_id, component_id, msg, esea_blackbox->first, esea_blackbox->count, esea_blackbox->fault, esea_blackbox->tick, esea_blackbox->records, esea_blackbox->size, esea_blackbox->whole, esea_blackbox->data);
}

/**
 * @brief Encode a esea_blackbox struct on a channel
 *
 * @param system_id ID of this system
 * @param component_id ID of this component (e.g. 200 for IMU)
 * @param chan The MAVLink channel this message will be sent over
 * @param msg The MAVLink message to compress the data into
 * @param esea_blackbox C-struct to read the message contents from
 */
static inline uint16_t mavlink_msg_esea_blackbox_encode_chan(uint8_t system_id, uint8_t component_id, uint8_t chan, mavlink_message_t* msg, const mavlink_esea_blackbox_t* esea_blackbox)
{
    return mavlink_msg_esea_blackbox_pack_chan(system_id, component_id, chan, msg, esea_blackbox->first, esea_blackbox->count, esea_blackbox->fault, esea_blackbox->tick, esea_blackbox->records, esea_blackbox->size, esea_blackbox->whole, esea_blackbox->data);
}

/**
 * @brief Encode a esea_blackbox struct with provided status structure
 *
 * @param system_id ID of this system
 * @param component_id ID of this component (e.g. 200 for IMU)
 * @param status MAVLink status structure
 * @param msg The MAVLink message to compress the data into
 * @param esea_blackbox C-struct to read the message contents from
 */
static inline uint16_t mavlink_msg_esea_blackbox_encode_status(uint8_t system_id, uint8_t component_id, mavlink_status_t* _status, mavlink_message_t* msg, const mavlink_esea_blackbox_t* esea_blackbox)
{
    return mavlink_msg_esea_blackbox_pack_status(system_id, component_id, _status, msg,  esea_blackbox->first, esea_blackbox->count, esea_blackbox->fault, esea_blackbox->tick, esea_blackbox->records, esea_blackbox->size, esea_blackbox->whole, esea_blackbox->data);
}

/**
 * @brief Send a esea_blackbox message
 * @param chan MAVLink channel to send the message
 *
 * @param first  Number of the first record here, the oldest is 0.
 * @param count  Records that there are; 0: it is not frozen.
 * @param fault  Why it was frozen.
 * @param tick  Base tick at which it was frozen.
 * @param records  Records here. To the board: 255 releases it.
 * @param size  Bytes of a record.
 * @param whole  Bit by record: whether its check holds.
 * @param data  Records as they lie in memory.
 */
#ifdef MAVLINK_USE_CONVENIENCE_FUNCTIONS

static inline void mavlink_msg_esea_blackbox_send(mavlink_channel_t chan, uint32_t first, uint32_t count, uint32_t fault, uint32_t tick, uint8_t records, uint8_t size, uint8_t whole, const uint8_t *data)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    char buf[MAVLINK_MSG_ID_ESEA_BLACKBOX_LEN];
    _mav_put_uint32_t(buf, 0, first);
    _mav_put_uint32_t(buf, 4, count);
    _mav_put_uint32_t(buf, 8, fault);
    _mav_put_uint32_t(buf, 12, tick);
    _mav_put_uint8_t(buf, 16, records);
    _mav_put_uint8_t(buf, 17, size);
    _mav_put_uint8_t(buf, 18, whole);
    _mav_put_uint8_t_array(buf, 19, data, 224);
    _mav_finalize_message_chan_send(chan, MAVLINK_MSG_ID_ESEA_BLACKBOX, buf, MAVLINK_MSG_ID_ESEA_BLACKBOX_MIN_LEN, MAVLINK_MSG_ID_ESEA_BLACKBOX_LEN, MAVLINK_MSG_ID_ESEA_BLACKBOX_CRC);
#else
    mavlink_esea_blackbox_t packet;
    packet.first = first;
    packet.count = count;
    packet.fault = fault;
    packet.tick = tick;
    packet.records = records;
    packet.size = size;
    packet.whole = whole;
    mav_array_memcpy(packet.data, data, sizeof(uint8_t)*224);
    _mav_finalize_message_chan_send(chan, MAVLINK_MSG_ID_ESEA_BLACKBOX, (const char *)&packet, MAVLINK_MSG_ID_ESEA_BLACKBOX_MIN_LEN, MAVLINK_MSG_ID_ESEA_BLACKBOX_LEN, MAVLINK_MSG_ID_ESEA_BLACKBOX_CRC);
#endif
}

/**
 * @brief Send a esea_blackbox message
 * @param chan MAVLink channel to send the message
 * @param struct The MAVLink struct to serialize
 */
static inline void mavlink_msg_esea_blackbox_send_struct(mavlink_channel_t chan, const mavlink_esea_blackbox_t* esea_blackbox)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    mavlink_msg_esea_blackbox_send(chan, esea_blackbox->first, esea_blackbox->count, esea_blackbox->fault, esea_blackbox->tick, esea_blackbox->records, esea_blackbox->size, esea_blackbox->whole, esea_blackbox->data);
#else
    _mav_finalize_message_chan_send(chan, MAVLINK_MSG_ID_ESEA_BLACKBOX, (const char *)esea_blackbox, MAVLINK_MSG_ID_ESEA_BLACKBOX_MIN_LEN, MAVLINK_MSG_ID_ESEA_BLACKBOX_LEN, MAVLINK_MSG_ID_ESEA_BLACKBOX_CRC);
#endif
}

#if MAVLINK_MSG_ID_ESEA_BLACKBOX_LEN <= MAVLINK_MAX_PAYLOAD_LEN
/*
  This variant of _send() can be used to save stack space by reusing
  memory from the receive buffer.  The caller provides a
  mavlink_message_t which is the size of a full mavlink message. This
  is usually the receive buffer for the channel, and allows a reply to an
  incoming message with minimum stack space usage.
 */
static inline void mavlink_msg_esea_blackbox_send_buf(mavlink_message_t *msgbuf, mavlink_channel_t chan,  uint32_t first, uint32_t count, uint32_t fault, uint32_t tick, uint8_t records, uint8_t size, uint8_t whole, const uint8_t *data)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    char *buf = (char *)msgbuf;
    _mav_put_uint32_t(buf, 0, first);
    _mav_put_uint32_t(buf, 4, count);
    _mav_put_uint32_t(buf, 8, fault);
    _mav_put_uint32_t(buf, 12, tick);
    _mav_put_uint8_t(buf, 16, records);
    _mav_put_uint8_t(buf, 17, size);
    _mav_put_uint8_t(buf, 18, whole);
    _mav_put_uint8_t_array(buf, 19, data, 224);
    _mav_finalize_message_chan_send(chan, MAVLINK_MSG_ID_ESEA_BLACKBOX, buf, MAVLINK_MSG_ID_ESEA_BLACKBOX_MIN_LEN, MAVLINK_MSG_ID_ESEA_BLACKBOX_LEN, MAVLINK_MSG_ID_ESEA_BLACKBOX_CRC);
#else
    mavlink_esea_blackbox_t *packet = (mavlink_esea_blackbox_t *)msgbuf;
    packet->first = first;
    packet->count = count;
    packet->fault = fault;
    packet->tick = tick;
    packet->records = records;
    packet->size = size;
    packet->whole = whole;
    mav_array_memcpy(packet->data, data, sizeof(uint8_t)*224);
    _mav_finalize_message_chan_send(chan, MAVLINK_MSG_ID_ESEA_BLACKBOX, (const char *)packet, MAVLINK_MSG_ID_ESEA_BLACKBOX_MIN_LEN, MAVLINK_MSG_ID_ESEA_BLACKBOX_LEN, MAVLINK_MSG_ID_ESEA_BLACKBOX_CRC);
#endif
}
#endif

#endif

// MESSAGE ESEA_BLACKBOX UNPACKING


/**
 * @brief Get field first from esea_blackbox message
 *
 * @return  Number of the first record here, the oldest is 0.
 */
static inline uint32_t mavlink_msg_esea_blackbox_get_first(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint32_t(msg,  0);
}

/**
 * @brief Get field count from esea_blackbox message
 *
 * @return  Records that there are; 0: it is not frozen.
 */
static inline uint32_t mavlink_msg_esea_blackbox_get_count(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint32_t(msg,  4);
}

/**
 * @brief Get field fault from esea_blackbox message
 *
 * @return  Why it was frozen.
 */
static inline uint32_t mavlink_msg_esea_blackbox_get_fault(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint32_t(msg,  8);
}

/**
 * @brief Get field tick from esea_blackbox message
 *
 * @return  Base tick at which it was frozen.
 */
static inline uint32_t mavlink_msg_esea_blackbox_get_tick(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint32_t(msg,  12);
}

/**
 * @brief Get field records from esea_blackbox message
 *
 * @return  Records here. To the board: 255 releases it.
 */
static inline uint8_t mavlink_msg_esea_blackbox_get_records(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint8_t(msg,  16);
}

/**
 * @brief Get field size from esea_blackbox message
 *
 * @return  Bytes of a record.
 */
static inline uint8_t mavlink_msg_esea_blackbox_get_size(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint8_t(msg,  17);
}

/**
 * @brief Get field whole from esea_blackbox message
 *
 * @return  Bit by record: whether its check holds.
 */
static inline uint8_t mavlink_msg_esea_blackbox_get_whole(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint8_t(msg,  18);
}

/**
 * @brief Get field data from esea_blackbox message
 *
 * @return  Records as they lie in memory.
 */
static inline uint16_t mavlink_msg_esea_blackbox_get_data(const mavlink_message_t* msg, uint8_t *data)
{
    return _MAV_RETURN_uint8_t_array(msg, data, 224,  19);
}

/**
 * @brief Decode a esea_blackbox message into a struct
 *
 * @param msg The message to decode
 * @param esea_blackbox C-struct to decode the message contents into
 */
static inline void mavlink_msg_esea_blackbox_decode(const mavlink_message_t* msg, mavlink_esea_blackbox_t* esea_blackbox)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    esea_blackbox->first = mavlink_msg_esea_blackbox_get_first(msg);
    esea_blackbox->count = mavlink_msg_esea_blackbox_get_count(msg);
    esea_blackbox->fault = mavlink_msg_esea_blackbox_get_fault(msg);
    esea_blackbox->tick = mavlink_msg_esea_blackbox_get_tick(msg);
    esea_blackbox->records = mavlink_msg_esea_blackbox_get_records(msg);
    esea_blackbox->size = mavlink_msg_esea_blackbox_get_size(msg);
    esea_blackbox->whole = mavlink_msg_esea_blackbox_get_whole(msg);
    mavlink_msg_esea_blackbox_get_data(msg, esea_blackbox->data);
#else
        uint8_t len = msg->len < MAVLINK_MSG_ID_ESEA_BLACKBOX_LEN? msg->len : MAVLINK_MSG_ID_ESEA_BLACKBOX_LEN;
        memset(esea_blackbox, 0, MAVLINK_MSG_ID_ESEA_BLACKBOX_LEN);
    memcpy(esea_blackbox, _MAV_PAYLOAD(msg), len);
#endif
}
