#pragma once
// MESSAGE ESEA_DATA PACKING

#include <stdint.h>

#define MAVLINK_MSG_ID_ESEA_DATA 42663


typedef struct __mavlink_esea_data_t {
 uint64_t time; /*<  Device clock at the first sample: base ticks since power-on, which no reset sets back.*/
 uint32_t sequence; /*<  Base tick of the first sample's run.*/
 uint16_t interval; /*<  Base ticks from one sample to the next.*/
 uint8_t stream; /*<  Number of the stream.*/
 uint8_t choice; /*<  Number that the stream was chosen with.*/
 uint8_t count; /*<  Samples in this message.*/
 uint8_t data[236]; /*<  Samples, one behind the other; the four bytes of each value.*/
} mavlink_esea_data_t;

#define MAVLINK_MSG_ID_ESEA_DATA_LEN 253
#define MAVLINK_MSG_ID_ESEA_DATA_MIN_LEN 253
#define MAVLINK_MSG_ID_42663_LEN 253
#define MAVLINK_MSG_ID_42663_MIN_LEN 253

#define MAVLINK_MSG_ID_ESEA_DATA_CRC 36
#define MAVLINK_MSG_ID_42663_CRC 36

#define MAVLINK_MSG_ESEA_DATA_FIELD_DATA_LEN 236

#if MAVLINK_COMMAND_24BIT
#define MAVLINK_MESSAGE_INFO_ESEA_DATA { \
    42663, \
    "ESEA_DATA", \
    7, \
    {  { "time", NULL, MAVLINK_TYPE_UINT64_T, 0, 0, offsetof(mavlink_esea_data_t, time) }, \
         { "sequence", NULL, MAVLINK_TYPE_UINT32_T, 0, 8, offsetof(mavlink_esea_data_t, sequence) }, \
         { "interval", NULL, MAVLINK_TYPE_UINT16_T, 0, 12, offsetof(mavlink_esea_data_t, interval) }, \
         { "stream", NULL, MAVLINK_TYPE_UINT8_T, 0, 14, offsetof(mavlink_esea_data_t, stream) }, \
         { "choice", NULL, MAVLINK_TYPE_UINT8_T, 0, 15, offsetof(mavlink_esea_data_t, choice) }, \
         { "count", NULL, MAVLINK_TYPE_UINT8_T, 0, 16, offsetof(mavlink_esea_data_t, count) }, \
         { "data", NULL, MAVLINK_TYPE_UINT8_T, 236, 17, offsetof(mavlink_esea_data_t, data) }, \
         } \
}
#else
#define MAVLINK_MESSAGE_INFO_ESEA_DATA { \
    "ESEA_DATA", \
    7, \
    {  { "time", NULL, MAVLINK_TYPE_UINT64_T, 0, 0, offsetof(mavlink_esea_data_t, time) }, \
         { "sequence", NULL, MAVLINK_TYPE_UINT32_T, 0, 8, offsetof(mavlink_esea_data_t, sequence) }, \
         { "interval", NULL, MAVLINK_TYPE_UINT16_T, 0, 12, offsetof(mavlink_esea_data_t, interval) }, \
         { "stream", NULL, MAVLINK_TYPE_UINT8_T, 0, 14, offsetof(mavlink_esea_data_t, stream) }, \
         { "choice", NULL, MAVLINK_TYPE_UINT8_T, 0, 15, offsetof(mavlink_esea_data_t, choice) }, \
         { "count", NULL, MAVLINK_TYPE_UINT8_T, 0, 16, offsetof(mavlink_esea_data_t, count) }, \
         { "data", NULL, MAVLINK_TYPE_UINT8_T, 236, 17, offsetof(mavlink_esea_data_t, data) }, \
         } \
}
#endif

/**
 * @brief Pack a esea_data message
 * @param system_id ID of this system
 * @param component_id ID of this component (e.g. 200 for IMU)
 * @param msg The MAVLink message to compress the data into
 *
 * @param time  Device clock at the first sample: base ticks since power-on, which no reset sets back.
 * @param sequence  Base tick of the first sample's run.
 * @param interval  Base ticks from one sample to the next.
 * @param stream  Number of the stream.
 * @param choice  Number that the stream was chosen with.
 * @param count  Samples in this message.
 * @param data  Samples, one behind the other; the four bytes of each value.
 * @return length of the message in bytes (excluding serial stream start sign)
 */
static inline uint16_t mavlink_msg_esea_data_pack(uint8_t system_id, uint8_t component_id, mavlink_message_t* msg,
                               uint64_t time, uint32_t sequence, uint16_t interval, uint8_t stream, uint8_t choice, uint8_t count, const uint8_t *data)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    char buf[MAVLINK_MSG_ID_ESEA_DATA_LEN];
    _mav_put_uint64_t(buf, 0, time);
    _mav_put_uint32_t(buf, 8, sequence);
    _mav_put_uint16_t(buf, 12, interval);
    _mav_put_uint8_t(buf, 14, stream);
    _mav_put_uint8_t(buf, 15, choice);
    _mav_put_uint8_t(buf, 16, count);
    _mav_put_uint8_t_array(buf, 17, data, 236);
        memcpy(_MAV_PAYLOAD_NON_CONST(msg), buf, MAVLINK_MSG_ID_ESEA_DATA_LEN);
#else
    mavlink_esea_data_t packet;
    packet.time = time;
    packet.sequence = sequence;
    packet.interval = interval;
    packet.stream = stream;
    packet.choice = choice;
    packet.count = count;
    mav_array_memcpy(packet.data, data, sizeof(uint8_t)*236);
        memcpy(_MAV_PAYLOAD_NON_CONST(msg), &packet, MAVLINK_MSG_ID_ESEA_DATA_LEN);
#endif

    msg->msgid = MAVLINK_MSG_ID_ESEA_DATA;
    return mavlink_finalize_message(msg, system_id, component_id, MAVLINK_MSG_ID_ESEA_DATA_MIN_LEN, MAVLINK_MSG_ID_ESEA_DATA_LEN, MAVLINK_MSG_ID_ESEA_DATA_CRC);
}

/**
 * @brief Pack a esea_data message
 * @param system_id ID of this system
 * @param component_id ID of this component (e.g. 200 for IMU)
 * @param status MAVLink status structure
 * @param msg The MAVLink message to compress the data into
 *
 * @param time  Device clock at the first sample: base ticks since power-on, which no reset sets back.
 * @param sequence  Base tick of the first sample's run.
 * @param interval  Base ticks from one sample to the next.
 * @param stream  Number of the stream.
 * @param choice  Number that the stream was chosen with.
 * @param count  Samples in this message.
 * @param data  Samples, one behind the other; the four bytes of each value.
 * @return length of the message in bytes (excluding serial stream start sign)
 */
static inline uint16_t mavlink_msg_esea_data_pack_status(uint8_t system_id, uint8_t component_id, mavlink_status_t *_status, mavlink_message_t* msg,
                               uint64_t time, uint32_t sequence, uint16_t interval, uint8_t stream, uint8_t choice, uint8_t count, const uint8_t *data)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    char buf[MAVLINK_MSG_ID_ESEA_DATA_LEN];
    _mav_put_uint64_t(buf, 0, time);
    _mav_put_uint32_t(buf, 8, sequence);
    _mav_put_uint16_t(buf, 12, interval);
    _mav_put_uint8_t(buf, 14, stream);
    _mav_put_uint8_t(buf, 15, choice);
    _mav_put_uint8_t(buf, 16, count);
    _mav_put_uint8_t_array(buf, 17, data, 236);
        memcpy(_MAV_PAYLOAD_NON_CONST(msg), buf, MAVLINK_MSG_ID_ESEA_DATA_LEN);
#else
    mavlink_esea_data_t packet;
    packet.time = time;
    packet.sequence = sequence;
    packet.interval = interval;
    packet.stream = stream;
    packet.choice = choice;
    packet.count = count;
    mav_array_memcpy(packet.data, data, sizeof(uint8_t)*236);
        memcpy(_MAV_PAYLOAD_NON_CONST(msg), &packet, MAVLINK_MSG_ID_ESEA_DATA_LEN);
#endif

    msg->msgid = MAVLINK_MSG_ID_ESEA_DATA;
#if MAVLINK_CRC_EXTRA
    return mavlink_finalize_message_buffer(msg, system_id, component_id, _status, MAVLINK_MSG_ID_ESEA_DATA_MIN_LEN, MAVLINK_MSG_ID_ESEA_DATA_LEN, MAVLINK_MSG_ID_ESEA_DATA_CRC);
#else
    return mavlink_finalize_message_buffer(msg, system_id, component_id, _status, MAVLINK_MSG_ID_ESEA_DATA_MIN_LEN, MAVLINK_MSG_ID_ESEA_DATA_LEN);
#endif
}

/**
 * @brief Pack a esea_data message on a channel
 * @param system_id ID of this system
 * @param component_id ID of this component (e.g. 200 for IMU)
 * @param chan The MAVLink channel this message will be sent over
 * @param msg The MAVLink message to compress the data into
 * @param time  Device clock at the first sample: base ticks since power-on, which no reset sets back.
 * @param sequence  Base tick of the first sample's run.
 * @param interval  Base ticks from one sample to the next.
 * @param stream  Number of the stream.
 * @param choice  Number that the stream was chosen with.
 * @param count  Samples in this message.
 * @param data  Samples, one behind the other; the four bytes of each value.
 * @return length of the message in bytes (excluding serial stream start sign)
 */
static inline uint16_t mavlink_msg_esea_data_pack_chan(uint8_t system_id, uint8_t component_id, uint8_t chan,
                               mavlink_message_t* msg,
                                   uint64_t time,uint32_t sequence,uint16_t interval,uint8_t stream,uint8_t choice,uint8_t count,const uint8_t *data)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    char buf[MAVLINK_MSG_ID_ESEA_DATA_LEN];
    _mav_put_uint64_t(buf, 0, time);
    _mav_put_uint32_t(buf, 8, sequence);
    _mav_put_uint16_t(buf, 12, interval);
    _mav_put_uint8_t(buf, 14, stream);
    _mav_put_uint8_t(buf, 15, choice);
    _mav_put_uint8_t(buf, 16, count);
    _mav_put_uint8_t_array(buf, 17, data, 236);
        memcpy(_MAV_PAYLOAD_NON_CONST(msg), buf, MAVLINK_MSG_ID_ESEA_DATA_LEN);
#else
    mavlink_esea_data_t packet;
    packet.time = time;
    packet.sequence = sequence;
    packet.interval = interval;
    packet.stream = stream;
    packet.choice = choice;
    packet.count = count;
    mav_array_memcpy(packet.data, data, sizeof(uint8_t)*236);
        memcpy(_MAV_PAYLOAD_NON_CONST(msg), &packet, MAVLINK_MSG_ID_ESEA_DATA_LEN);
#endif

    msg->msgid = MAVLINK_MSG_ID_ESEA_DATA;
    return mavlink_finalize_message_chan(msg, system_id, component_id, chan, MAVLINK_MSG_ID_ESEA_DATA_MIN_LEN, MAVLINK_MSG_ID_ESEA_DATA_LEN, MAVLINK_MSG_ID_ESEA_DATA_CRC);
}

/**
 * @brief Encode a esea_data struct
 *
 * @param system_id ID of this system
 * @param component_id ID of this component (e.g. 200 for IMU)
 * @param msg The MAVLink message to compress the data into
 * @param esea_data C-struct to read the message contents from
 */
static inline uint16_t mavlink_msg_esea_data_encode(uint8_t system_id, uint8_t component_id, mavlink_message_t* msg, const mavlink_esea_data_t* esea_data)
{
    return mavlink_msg_esea_data_pack(system_id, component_id, msg, esea_data->time, esea_data->sequence, esea_data->interval, esea_data->stream, esea_data->choice, esea_data->count, esea_data->data);
}

/**
 * @brief Encode a esea_data struct on a channel
 *
 * @param system_id ID of this system
 * @param component_id ID of this component (e.g. 200 for IMU)
 * @param chan The MAVLink channel this message will be sent over
 * @param msg The MAVLink message to compress the data into
 * @param esea_data C-struct to read the message contents from
 */
static inline uint16_t mavlink_msg_esea_data_encode_chan(uint8_t system_id, uint8_t component_id, uint8_t chan, mavlink_message_t* msg, const mavlink_esea_data_t* esea_data)
{
    return mavlink_msg_esea_data_pack_chan(system_id, component_id, chan, msg, esea_data->time, esea_data->sequence, esea_data->interval, esea_data->stream, esea_data->choice, esea_data->count, esea_data->data);
}

/**
 * @brief Encode a esea_data struct with provided status structure
 *
 * @param system_id ID of this system
 * @param component_id ID of this component (e.g. 200 for IMU)
 * @param status MAVLink status structure
 * @param msg The MAVLink message to compress the data into
 * @param esea_data C-struct to read the message contents from
 */
static inline uint16_t mavlink_msg_esea_data_encode_status(uint8_t system_id, uint8_t component_id, mavlink_status_t* _status, mavlink_message_t* msg, const mavlink_esea_data_t* esea_data)
{
    return mavlink_msg_esea_data_pack_status(system_id, component_id, _status, msg,  esea_data->time, esea_data->sequence, esea_data->interval, esea_data->stream, esea_data->choice, esea_data->count, esea_data->data);
}

/**
 * @brief Send a esea_data message
 * @param chan MAVLink channel to send the message
 *
 * @param time  Device clock at the first sample: base ticks since power-on, which no reset sets back.
 * @param sequence  Base tick of the first sample's run.
 * @param interval  Base ticks from one sample to the next.
 * @param stream  Number of the stream.
 * @param choice  Number that the stream was chosen with.
 * @param count  Samples in this message.
 * @param data  Samples, one behind the other; the four bytes of each value.
 */
#ifdef MAVLINK_USE_CONVENIENCE_FUNCTIONS

static inline void mavlink_msg_esea_data_send(mavlink_channel_t chan, uint64_t time, uint32_t sequence, uint16_t interval, uint8_t stream, uint8_t choice, uint8_t count, const uint8_t *data)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    char buf[MAVLINK_MSG_ID_ESEA_DATA_LEN];
    _mav_put_uint64_t(buf, 0, time);
    _mav_put_uint32_t(buf, 8, sequence);
    _mav_put_uint16_t(buf, 12, interval);
    _mav_put_uint8_t(buf, 14, stream);
    _mav_put_uint8_t(buf, 15, choice);
    _mav_put_uint8_t(buf, 16, count);
    _mav_put_uint8_t_array(buf, 17, data, 236);
    _mav_finalize_message_chan_send(chan, MAVLINK_MSG_ID_ESEA_DATA, buf, MAVLINK_MSG_ID_ESEA_DATA_MIN_LEN, MAVLINK_MSG_ID_ESEA_DATA_LEN, MAVLINK_MSG_ID_ESEA_DATA_CRC);
#else
    mavlink_esea_data_t packet;
    packet.time = time;
    packet.sequence = sequence;
    packet.interval = interval;
    packet.stream = stream;
    packet.choice = choice;
    packet.count = count;
    mav_array_memcpy(packet.data, data, sizeof(uint8_t)*236);
    _mav_finalize_message_chan_send(chan, MAVLINK_MSG_ID_ESEA_DATA, (const char *)&packet, MAVLINK_MSG_ID_ESEA_DATA_MIN_LEN, MAVLINK_MSG_ID_ESEA_DATA_LEN, MAVLINK_MSG_ID_ESEA_DATA_CRC);
#endif
}

/**
 * @brief Send a esea_data message
 * @param chan MAVLink channel to send the message
 * @param struct The MAVLink struct to serialize
 */
static inline void mavlink_msg_esea_data_send_struct(mavlink_channel_t chan, const mavlink_esea_data_t* esea_data)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    mavlink_msg_esea_data_send(chan, esea_data->time, esea_data->sequence, esea_data->interval, esea_data->stream, esea_data->choice, esea_data->count, esea_data->data);
#else
    _mav_finalize_message_chan_send(chan, MAVLINK_MSG_ID_ESEA_DATA, (const char *)esea_data, MAVLINK_MSG_ID_ESEA_DATA_MIN_LEN, MAVLINK_MSG_ID_ESEA_DATA_LEN, MAVLINK_MSG_ID_ESEA_DATA_CRC);
#endif
}

#if MAVLINK_MSG_ID_ESEA_DATA_LEN <= MAVLINK_MAX_PAYLOAD_LEN
/*
  This variant of _send() can be used to save stack space by reusing
  memory from the receive buffer.  The caller provides a
  mavlink_message_t which is the size of a full mavlink message. This
  is usually the receive buffer for the channel, and allows a reply to an
  incoming message with minimum stack space usage.
 */
static inline void mavlink_msg_esea_data_send_buf(mavlink_message_t *msgbuf, mavlink_channel_t chan,  uint64_t time, uint32_t sequence, uint16_t interval, uint8_t stream, uint8_t choice, uint8_t count, const uint8_t *data)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    char *buf = (char *)msgbuf;
    _mav_put_uint64_t(buf, 0, time);
    _mav_put_uint32_t(buf, 8, sequence);
    _mav_put_uint16_t(buf, 12, interval);
    _mav_put_uint8_t(buf, 14, stream);
    _mav_put_uint8_t(buf, 15, choice);
    _mav_put_uint8_t(buf, 16, count);
    _mav_put_uint8_t_array(buf, 17, data, 236);
    _mav_finalize_message_chan_send(chan, MAVLINK_MSG_ID_ESEA_DATA, buf, MAVLINK_MSG_ID_ESEA_DATA_MIN_LEN, MAVLINK_MSG_ID_ESEA_DATA_LEN, MAVLINK_MSG_ID_ESEA_DATA_CRC);
#else
    mavlink_esea_data_t *packet = (mavlink_esea_data_t *)msgbuf;
    packet->time = time;
    packet->sequence = sequence;
    packet->interval = interval;
    packet->stream = stream;
    packet->choice = choice;
    packet->count = count;
    mav_array_memcpy(packet->data, data, sizeof(uint8_t)*236);
    _mav_finalize_message_chan_send(chan, MAVLINK_MSG_ID_ESEA_DATA, (const char *)packet, MAVLINK_MSG_ID_ESEA_DATA_MIN_LEN, MAVLINK_MSG_ID_ESEA_DATA_LEN, MAVLINK_MSG_ID_ESEA_DATA_CRC);
#endif
}
#endif

#endif

// MESSAGE ESEA_DATA UNPACKING


/**
 * @brief Get field time from esea_data message
 *
 * @return  Device clock at the first sample: base ticks since power-on, which no reset sets back.
 */
static inline uint64_t mavlink_msg_esea_data_get_time(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint64_t(msg,  0);
}

/**
 * @brief Get field sequence from esea_data message
 *
 * @return  Base tick of the first sample's run.
 */
static inline uint32_t mavlink_msg_esea_data_get_sequence(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint32_t(msg,  8);
}

/**
 * @brief Get field interval from esea_data message
 *
 * @return  Base ticks from one sample to the next.
 */
static inline uint16_t mavlink_msg_esea_data_get_interval(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint16_t(msg,  12);
}

/**
 * @brief Get field stream from esea_data message
 *
 * @return  Number of the stream.
 */
static inline uint8_t mavlink_msg_esea_data_get_stream(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint8_t(msg,  14);
}

/**
 * @brief Get field choice from esea_data message
 *
 * @return  Number that the stream was chosen with.
 */
static inline uint8_t mavlink_msg_esea_data_get_choice(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint8_t(msg,  15);
}

/**
 * @brief Get field count from esea_data message
 *
 * @return  Samples in this message.
 */
static inline uint8_t mavlink_msg_esea_data_get_count(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint8_t(msg,  16);
}

/**
 * @brief Get field data from esea_data message
 *
 * @return  Samples, one behind the other; the four bytes of each value.
 */
static inline uint16_t mavlink_msg_esea_data_get_data(const mavlink_message_t* msg, uint8_t *data)
{
    return _MAV_RETURN_uint8_t_array(msg, data, 236,  17);
}

/**
 * @brief Decode a esea_data message into a struct
 *
 * @param msg The message to decode
 * @param esea_data C-struct to decode the message contents into
 */
static inline void mavlink_msg_esea_data_decode(const mavlink_message_t* msg, mavlink_esea_data_t* esea_data)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    esea_data->time = mavlink_msg_esea_data_get_time(msg);
    esea_data->sequence = mavlink_msg_esea_data_get_sequence(msg);
    esea_data->interval = mavlink_msg_esea_data_get_interval(msg);
    esea_data->stream = mavlink_msg_esea_data_get_stream(msg);
    esea_data->choice = mavlink_msg_esea_data_get_choice(msg);
    esea_data->count = mavlink_msg_esea_data_get_count(msg);
    mavlink_msg_esea_data_get_data(msg, esea_data->data);
#else
        uint8_t len = msg->len < MAVLINK_MSG_ID_ESEA_DATA_LEN? msg->len : MAVLINK_MSG_ID_ESEA_DATA_LEN;
        memset(esea_data, 0, MAVLINK_MSG_ID_ESEA_DATA_LEN);
    memcpy(esea_data, _MAV_PAYLOAD(msg), len);
#endif
}
