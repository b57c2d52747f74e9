#pragma once
// MESSAGE ESEA_LIFE PACKING

#include <stdint.h>

#define MAVLINK_MSG_ID_ESEA_LIFE 42668


typedef struct __mavlink_esea_life_t {
 uint32_t serial; /*<  Serial number on the coupling; 0: nobody said.*/
 uint32_t seconds; /*< [s] Time counted.*/
 uint32_t full; /*<  Times that there was no room for a turning point.*/
 float energy_J; /*<  Energy that it has taken.*/
 float width_rad; /*< [rad] Width of a class of ranges.*/
 uint32_t halves[48]; /*<  Half cycles by class of the deflection's range, as if its history ended now; ranges below one class are not counted.*/
 uint8_t number; /*<  Of the record: the couplings that are fitted, then those that lie aside. To the board: the coupling whose serial number this is; 255: forgets one that lies aside.*/
 uint8_t couplings; /*<  How many the device has.*/
 uint8_t records; /*<  How many records there are.*/
 uint8_t result; /*<  Of naming the coupling.*/
} mavlink_esea_life_t;

#define MAVLINK_MSG_ID_ESEA_LIFE_LEN 216
#define MAVLINK_MSG_ID_ESEA_LIFE_MIN_LEN 216
#define MAVLINK_MSG_ID_42668_LEN 216
#define MAVLINK_MSG_ID_42668_MIN_LEN 216

#define MAVLINK_MSG_ID_ESEA_LIFE_CRC 239
#define MAVLINK_MSG_ID_42668_CRC 239

#define MAVLINK_MSG_ESEA_LIFE_FIELD_HALVES_LEN 48

#if MAVLINK_COMMAND_24BIT
#define MAVLINK_MESSAGE_INFO_ESEA_LIFE { \
    42668, \
    "ESEA_LIFE", \
    10, \
    {  { "serial", NULL, MAVLINK_TYPE_UINT32_T, 0, 0, offsetof(mavlink_esea_life_t, serial) }, \
         { "seconds", NULL, MAVLINK_TYPE_UINT32_T, 0, 4, offsetof(mavlink_esea_life_t, seconds) }, \
         { "full", NULL, MAVLINK_TYPE_UINT32_T, 0, 8, offsetof(mavlink_esea_life_t, full) }, \
         { "energy_J", NULL, MAVLINK_TYPE_FLOAT, 0, 12, offsetof(mavlink_esea_life_t, energy_J) }, \
         { "width_rad", NULL, MAVLINK_TYPE_FLOAT, 0, 16, offsetof(mavlink_esea_life_t, width_rad) }, \
         { "halves", NULL, MAVLINK_TYPE_UINT32_T, 48, 20, offsetof(mavlink_esea_life_t, halves) }, \
         { "number", NULL, MAVLINK_TYPE_UINT8_T, 0, 212, offsetof(mavlink_esea_life_t, number) }, \
         { "couplings", NULL, MAVLINK_TYPE_UINT8_T, 0, 213, offsetof(mavlink_esea_life_t, couplings) }, \
         { "records", NULL, MAVLINK_TYPE_UINT8_T, 0, 214, offsetof(mavlink_esea_life_t, records) }, \
         { "result", NULL, MAVLINK_TYPE_UINT8_T, 0, 215, offsetof(mavlink_esea_life_t, result) }, \
         } \
}
#else
#define MAVLINK_MESSAGE_INFO_ESEA_LIFE { \
    "ESEA_LIFE", \
    10, \
    {  { "serial", NULL, MAVLINK_TYPE_UINT32_T, 0, 0, offsetof(mavlink_esea_life_t, serial) }, \
         { "seconds", NULL, MAVLINK_TYPE_UINT32_T, 0, 4, offsetof(mavlink_esea_life_t, seconds) }, \
         { "full", NULL, MAVLINK_TYPE_UINT32_T, 0, 8, offsetof(mavlink_esea_life_t, full) }, \
         { "energy_J", NULL, MAVLINK_TYPE_FLOAT, 0, 12, offsetof(mavlink_esea_life_t, energy_J) }, \
         { "width_rad", NULL, MAVLINK_TYPE_FLOAT, 0, 16, offsetof(mavlink_esea_life_t, width_rad) }, \
         { "halves", NULL, MAVLINK_TYPE_UINT32_T, 48, 20, offsetof(mavlink_esea_life_t, halves) }, \
         { "number", NULL, MAVLINK_TYPE_UINT8_T, 0, 212, offsetof(mavlink_esea_life_t, number) }, \
         { "couplings", NULL, MAVLINK_TYPE_UINT8_T, 0, 213, offsetof(mavlink_esea_life_t, couplings) }, \
         { "records", NULL, MAVLINK_TYPE_UINT8_T, 0, 214, offsetof(mavlink_esea_life_t, records) }, \
         { "result", NULL, MAVLINK_TYPE_UINT8_T, 0, 215, offsetof(mavlink_esea_life_t, result) }, \
         } \
}
#endif

/**
 * @brief Pack a esea_life message
 * @param system_id ID of this system
 * @param component_id ID of this component (e.g. 200 for IMU)
 * @param msg The MAVLink message to compress the data into
 *
 * @param serial  Serial number on the coupling; 0: nobody said.
 * @param seconds [s] Time counted.
 * @param full  Times that there was no room for a turning point.
 * @param energy_J  Energy that it has taken.
 * @param width_rad [rad] Width of a class of ranges.
 * @param halves  Half cycles by class of the deflection's range, as if its history ended now; ranges below one class are not counted.
 * @param number  Of the record: the couplings that are fitted, then those that lie aside. To the board: the coupling whose serial number this is; 255: forgets one that lies aside.
 * @param couplings  How many the device has.
 * @param records  How many records there are.
 * @param result  Of naming the coupling.
 * @return length of the message in bytes (excluding serial stream start sign)
 */
static inline uint16_t mavlink_msg_esea_life_pack(uint8_t system_id, uint8_t component_id, mavlink_message_t* msg,
                               uint32_t serial, uint32_t seconds, uint32_t full, float energy_J, float width_rad, const uint32_t *halves, uint8_t number, uint8_t couplings, uint8_t records, uint8_t result)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    char buf[MAVLINK_MSG_ID_ESEA_LIFE_LEN];
    _mav_put_uint32_t(buf, 0, serial);
    _mav_put_uint32_t(buf, 4, seconds);
    _mav_put_uint32_t(buf, 8, full);
    _mav_put_float(buf, 12, energy_J);
    _mav_put_float(buf, 16, width_rad);
    _mav_put_uint8_t(buf, 212, number);
    _mav_put_uint8_t(buf, 213, couplings);
    _mav_put_uint8_t(buf, 214, records);
    _mav_put_uint8_t(buf, 215, result);
    _mav_put_uint32_t_array(buf, 20, halves, 48);
        memcpy(_MAV_PAYLOAD_NON_CONST(msg), buf, MAVLINK_MSG_ID_ESEA_LIFE_LEN);
#else
    mavlink_esea_life_t packet;
    packet.serial = serial;
    packet.seconds = seconds;
    packet.full = full;
    packet.energy_J = energy_J;
    packet.width_rad = width_rad;
    packet.number = number;
    packet.couplings = couplings;
    packet.records = records;
    packet.result = result;
    mav_array_memcpy(packet.halves, halves, sizeof(uint32_t)*48);
        memcpy(_MAV_PAYLOAD_NON_CONST(msg), &packet, MAVLINK_MSG_ID_ESEA_LIFE_LEN);
#endif

    msg->msgid = MAVLINK_MSG_ID_ESEA_LIFE;
    return mavlink_finalize_message(msg, system_id, component_id, MAVLINK_MSG_ID_ESEA_LIFE_MIN_LEN, MAVLINK_MSG_ID_ESEA_LIFE_LEN, MAVLINK_MSG_ID_ESEA_LIFE_CRC);
}

/**
 * @brief Pack a esea_life message
 * @param system_id ID of this system
 * @param component_id ID of this component (e.g. 200 for IMU)
 * @param status MAVLink status structure
 * @param msg The MAVLink message to compress the data into
 *
 * @param serial  Serial number on the coupling; 0: nobody said.
 * @param seconds [s] Time counted.
 * @param full  Times that there was no room for a turning point.
 * @param energy_J  Energy that it has taken.
 * @param width_rad [rad] Width of a class of ranges.
 * @param halves  Half cycles by class of the deflection's range, as if its history ended now; ranges below one class are not counted.
 * @param number  Of the record: the couplings that are fitted, then those that lie aside. To the board: the coupling whose serial number this is; 255: forgets one that lies aside.
 * @param couplings  How many the device has.
 * @param records  How many records there are.
 * @param result  Of naming the coupling.
 * @return length of the message in bytes (excluding serial stream start sign)
 */
static inline uint16_t mavlink_msg_esea_life_pack_status(uint8_t system_id, uint8_t component_id, mavlink_status_t *_status, mavlink_message_t* msg,
                               uint32_t serial, uint32_t seconds, uint32_t full, float energy_J, float width_rad, const uint32_t *halves, uint8_t number, uint8_t couplings, uint8_t records, uint8_t result)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    char buf[MAVLINK_MSG_ID_ESEA_LIFE_LEN];
    _mav_put_uint32_t(buf, 0, serial);
    _mav_put_uint32_t(buf, 4, seconds);
    _mav_put_uint32_t(buf, 8, full);
    _mav_put_float(buf, 12, energy_J);
    _mav_put_float(buf, 16, width_rad);
    _mav_put_uint8_t(buf, 212, number);
    _mav_put_uint8_t(buf, 213, couplings);
    _mav_put_uint8_t(buf, 214, records);
    _mav_put_uint8_t(buf, 215, result);
    _mav_put_uint32_t_array(buf, 20, halves, 48);
        memcpy(_MAV_PAYLOAD_NON_CONST(msg), buf, MAVLINK_MSG_ID_ESEA_LIFE_LEN);
#else
    mavlink_esea_life_t packet;
    packet.serial = serial;
    packet.seconds = seconds;
    packet.full = full;
    packet.energy_J = energy_J;
    packet.width_rad = width_rad;
    packet.number = number;
    packet.couplings = couplings;
    packet.records = records;
    packet.result = result;
    mav_array_memcpy(packet.halves, halves, sizeof(uint32_t)*48);
        memcpy(_MAV_PAYLOAD_NON_CONST(msg), &packet, MAVLINK_MSG_ID_ESEA_LIFE_LEN);
#endif

    msg->msgid = MAVLINK_MSG_ID_ESEA_LIFE;
#if MAVLINK_CRC_EXTRA
    return mavlink_finalize_message_buffer(msg, system_id, component_id, _status, MAVLINK_MSG_ID_ESEA_LIFE_MIN_LEN, MAVLINK_MSG_ID_ESEA_LIFE_LEN, MAVLINK_MSG_ID_ESEA_LIFE_CRC);
#else
    return mavlink_finalize_message_buffer(msg, system_id, component_id, _status, MAVLINK_MSG_ID_ESEA_LIFE_MIN_LEN, MAVLINK_MSG_ID_ESEA_LIFE_LEN);
#endif
}

/**
 * @brief Pack a esea_life message on a channel
 * @param system_id ID of this system
 * @param component_id ID of this component (e.g. 200 for IMU)
 * @param chan The MAVLink channel this message will be sent over
 * @param msg The MAVLink message to compress the data into
 * @param serial  Serial number on the coupling; 0: nobody said.
 * @param seconds [s] Time counted.
 * @param full  Times that there was no room for a turning point.
 * @param energy_J  Energy that it has taken.
 * @param width_rad [rad] Width of a class of ranges.
 * @param halves  Half cycles by class of the deflection's range, as if its history ended now; ranges below one class are not counted.
 * @param number  Of the record: the couplings that are fitted, then those that lie aside. To the board: the coupling whose serial number this is; 255: forgets one that lies aside.
 * @param couplings  How many the device has.
 * @param records  How many records there are.
 * @param result  Of naming the coupling.
 * @return length of the message in bytes (excluding serial stream start sign)
 */
static inline uint16_t mavlink_msg_esea_life_pack_chan(uint8_t system_id, uint8_t component_id, uint8_t chan,
                               mavlink_message_t* msg,
                                   uint32_t serial,uint32_t seconds,uint32_t full,float energy_J,float width_rad,const uint32_t *halves,uint8_t number,uint8_t couplings,uint8_t records,uint8_t result)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    char buf[MAVLINK_MSG_ID_ESEA_LIFE_LEN];
    _mav_put_uint32_t(buf, 0, serial);
    _mav_put_uint32_t(buf, 4, seconds);
    _mav_put_uint32_t(buf, 8, full);
    _mav_put_float(buf, 12, energy_J);
    _mav_put_float(buf, 16, width_rad);
    _mav_put_uint8_t(buf, 212, number);
    _mav_put_uint8_t(buf, 213, couplings);
    _mav_put_uint8_t(buf, 214, records);
    _mav_put_uint8_t(buf, 215, result);
    _mav_put_uint32_t_array(buf, 20, halves, 48);
        memcpy(_MAV_PAYLOAD_NON_CONST(msg), buf, MAVLINK_MSG_ID_ESEA_LIFE_LEN);
#else
    mavlink_esea_life_t packet;
    packet.serial = serial;
    packet.seconds = seconds;
    packet.full = full;
    packet.energy_J = energy_J;
    packet.width_rad = width_rad;
    packet.number = number;
    packet.couplings = couplings;
    packet.records = records;
    packet.result = result;
    mav_array_memcpy(packet.halves, halves, sizeof(uint32_t)*48);
        memcpy(_MAV_PAYLOAD_NON_CONST(msg), &packet, MAVLINK_MSG_ID_ESEA_LIFE_LEN);
#endif

    msg->msgid = MAVLINK_MSG_ID_ESEA_LIFE;
    return mavlink_finalize_message_chan(msg, system_id, component_id, chan, MAVLINK_MSG_ID_ESEA_LIFE_MIN_LEN, MAVLINK_MSG_ID_ESEA_LIFE_LEN, MAVLINK_MSG_ID_ESEA_LIFE_CRC);
}

/**
 * @brief Encode a esea_life struct
 *
 * @param system_id ID of this system
 * @param component_id ID of this component (e.g. 200 for IMU)
 * @param msg The MAVLink message to compress the data into
 * @param esea_life C-struct to read the message contents from
 */
static inline uint16_t mavlink_msg_esea_life_encode(uint8_t system_id, uint8_t component_id, mavlink_message_t* msg, const mavlink_esea_life_t* esea_life)
{
    return mavlink_msg_esea_life_pack(system_id, component_id, msg, esea_life->serial, esea_life->seconds, esea_life->full, esea_life->energy_J, esea_life->width_rad, esea_life->halves, esea_life->number, esea_life->couplings, esea_life->records, esea_life->result);
}

/**
 * @brief Encode a esea_life struct on a channel
 *
 * @param system_id ID of this system
 * @param component_id ID of this component (e.g. 200 for IMU)
 * @param chan The MAVLink channel this message will be sent over
 * @param msg The MAVLink message to compress the data into
 * @param esea_life C-struct to read the message contents from
 */
static inline uint16_t mavlink_msg_esea_life_encode_chan(uint8_t system_id, uint8_t component_id, uint8_t chan, mavlink_message_t* msg, const mavlink_esea_life_t* esea_life)
{
    return mavlink_msg_esea_life_pack_chan(system_id, component_id, chan, msg, esea_life->serial, esea_life->seconds, esea_life->full, esea_life->energy_J, esea_life->width_rad, esea_life->halves, esea_life->number, esea_life->couplings, esea_life->records, esea_life->result);
}

/**
 * @brief Encode a esea_life struct with provided status structure
 *
 * @param system_id ID of this system
 * @param component_id ID of this component (e.g. 200 for IMU)
 * @param status MAVLink status structure
 * @param msg The MAVLink message to compress the data into
 * @param esea_life C-struct to read the message contents from
 */
static inline uint16_t mavlink_msg_esea_life_encode_status(uint8_t system_id, uint8_t component_id, mavlink_status_t* _status, mavlink_message_t* msg, const mavlink_esea_life_t* esea_life)
{
    return mavlink_msg_esea_life_pack_status(system_id, component_id, _status, msg,  esea_life->serial, esea_life->seconds, esea_life->full, esea_life->energy_J, esea_life->width_rad, esea_life->halves, esea_life->number, esea_life->couplings, esea_life->records, esea_life->result);
}

/**
 * @brief Send a esea_life message
 * @param chan MAVLink channel to send the message
 *
 * @param serial  Serial number on the coupling; 0: nobody said.
 * @param seconds [s] Time counted.
 * @param full  Times that there was no room for a turning point.
 * @param energy_J  Energy that it has taken.
 * @param width_rad [rad] Width of a class of ranges.
 * @param halves  Half cycles by class of the deflection's range, as if its history ended now; ranges below one class are not counted.
 * @param number  Of the record: the couplings that are fitted, then those that lie aside. To the board: the coupling whose serial number this is; 255: forgets one that lies aside.
 * @param couplings  How many the device has.
 * @param records  How many records there are.
 * @param result  Of naming the coupling.
 */
#ifdef MAVLINK_USE_CONVENIENCE_FUNCTIONS

static inline void mavlink_msg_esea_life_send(mavlink_channel_t chan, uint32_t serial, uint32_t seconds, uint32_t full, float energy_J, float width_rad, const uint32_t *halves, uint8_t number, uint8_t couplings, uint8_t records, uint8_t result)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    char buf[MAVLINK_MSG_ID_ESEA_LIFE_LEN];
    _mav_put_uint32_t(buf, 0, serial);
    _mav_put_uint32_t(buf, 4, seconds);
    _mav_put_uint32_t(buf, 8, full);
    _mav_put_float(buf, 12, energy_J);
    _mav_put_float(buf, 16, width_rad);
    _mav_put_uint8_t(buf, 212, number);
    _mav_put_uint8_t(buf, 213, couplings);
    _mav_put_uint8_t(buf, 214, records);
    _mav_put_uint8_t(buf, 215, result);
    _mav_put_uint32_t_array(buf, 20, halves, 48);
    _mav_finalize_message_chan_send(chan, MAVLINK_MSG_ID_ESEA_LIFE, buf, MAVLINK_MSG_ID_ESEA_LIFE_MIN_LEN, MAVLINK_MSG_ID_ESEA_LIFE_LEN, MAVLINK_MSG_ID_ESEA_LIFE_CRC);
#else
    mavlink_esea_life_t packet;
    packet.serial = serial;
    packet.seconds = seconds;
    packet.full = full;
    packet.energy_J = energy_J;
    packet.width_rad = width_rad;
    packet.number = number;
    packet.couplings = couplings;
    packet.records = records;
    packet.result = result;
    mav_array_memcpy(packet.halves, halves, sizeof(uint32_t)*48);
    _mav_finalize_message_chan_send(chan, MAVLINK_MSG_ID_ESEA_LIFE, (const char *)&packet, MAVLINK_MSG_ID_ESEA_LIFE_MIN_LEN, MAVLINK_MSG_ID_ESEA_LIFE_LEN, MAVLINK_MSG_ID_ESEA_LIFE_CRC);
#endif
}

/**
 * @brief Send a esea_life message
 * @param chan MAVLink channel to send the message
 * @param struct The MAVLink struct to serialize
 */
static inline void mavlink_msg_esea_life_send_struct(mavlink_channel_t chan, const mavlink_esea_life_t* esea_life)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    mavlink_msg_esea_life_send(chan, esea_life->serial, esea_life->seconds, esea_life->full, esea_life->energy_J, esea_life->width_rad, esea_life->halves, esea_life->number, esea_life->couplings, esea_life->records, esea_life->result);
#else
    _mav_finalize_message_chan_send(chan, MAVLINK_MSG_ID_ESEA_LIFE, (const char *)esea_life, MAVLINK_MSG_ID_ESEA_LIFE_MIN_LEN, MAVLINK_MSG_ID_ESEA_LIFE_LEN, MAVLINK_MSG_ID_ESEA_LIFE_CRC);
#endif
}

#if MAVLINK_MSG_ID_ESEA_LIFE_LEN <= MAVLINK_MAX_PAYLOAD_LEN
/*
  This variant of _send() can be used to save stack space by reusing
  memory from the receive buffer.  The caller provides a
  mavlink_message_t which is the size of a full mavlink message. This
  is usually the receive buffer for the channel, and allows a reply to an
  incoming message with minimum stack space usage.
 */
static inline void mavlink_msg_esea_life_send_buf(mavlink_message_t *msgbuf, mavlink_channel_t chan,  uint32_t serial, uint32_t seconds, uint32_t full, float energy_J, float width_rad, const uint32_t *halves, uint8_t number, uint8_t couplings, uint8_t records, uint8_t result)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    char *buf = (char *)msgbuf;
    _mav_put_uint32_t(buf, 0, serial);
    _mav_put_uint32_t(buf, 4, seconds);
    _mav_put_uint32_t(buf, 8, full);
    _mav_put_float(buf, 12, energy_J);
    _mav_put_float(buf, 16, width_rad);
    _mav_put_uint8_t(buf, 212, number);
    _mav_put_uint8_t(buf, 213, couplings);
    _mav_put_uint8_t(buf, 214, records);
    _mav_put_uint8_t(buf, 215, result);
    _mav_put_uint32_t_array(buf, 20, halves, 48);
    _mav_finalize_message_chan_send(chan, MAVLINK_MSG_ID_ESEA_LIFE, buf, MAVLINK_MSG_ID_ESEA_LIFE_MIN_LEN, MAVLINK_MSG_ID_ESEA_LIFE_LEN, MAVLINK_MSG_ID_ESEA_LIFE_CRC);
#else
    mavlink_esea_life_t *packet = (mavlink_esea_life_t *)msgbuf;
    packet->serial = serial;
    packet->seconds = seconds;
    packet->full = full;
    packet->energy_J = energy_J;
    packet->width_rad = width_rad;
    packet->number = number;
    packet->couplings = couplings;
    packet->records = records;
    packet->result = result;
    mav_array_memcpy(packet->halves, halves, sizeof(uint32_t)*48);
    _mav_finalize_message_chan_send(chan, MAVLINK_MSG_ID_ESEA_LIFE, (const char *)packet, MAVLINK_MSG_ID_ESEA_LIFE_MIN_LEN, MAVLINK_MSG_ID_ESEA_LIFE_LEN, MAVLINK_MSG_ID_ESEA_LIFE_CRC);
#endif
}
#endif

#endif

// MESSAGE ESEA_LIFE UNPACKING


/**
 * @brief Get field serial from esea_life message
 *
 * @return  Serial number on the coupling; 0: nobody said.
 */
static inline uint32_t mavlink_msg_esea_life_get_serial(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint32_t(msg,  0);
}

/**
 * @brief Get field seconds from esea_life message
 *
 * @return [s] Time counted.
 */
static inline uint32_t mavlink_msg_esea_life_get_seconds(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint32_t(msg,  4);
}

/**
 * @brief Get field full from esea_life message
 *
 * @return  Times that there was no room for a turning point.
 */
static inline uint32_t mavlink_msg_esea_life_get_full(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint32_t(msg,  8);
}

/**
 * @brief Get field energy_J from esea_life message
 *
 * @return  Energy that it has taken.
 */
static inline float mavlink_msg_esea_life_get_energy_J(const mavlink_message_t* msg)
{
    return _MAV_RETURN_float(msg,  12);
}

/**
 * @brief Get field width_rad from esea_life message
 *
 * @return [rad] Width of a class of ranges.
 */
static inline float mavlink_msg_esea_life_get_width_rad(const mavlink_message_t* msg)
{
    return _MAV_RETURN_float(msg,  16);
}

/**
 * @brief Get field halves from esea_life message
 *
 * @return  Half cycles by class of the deflection's range, as if its history ended now; ranges below one class are not counted.
 */
static inline uint16_t mavlink_msg_esea_life_get_halves(const mavlink_message_t* msg, uint32_t *halves)
{
    return _MAV_RETURN_uint32_t_array(msg, halves, 48,  20);
}

/**
 * @brief Get field number from esea_life message
 *
 * @return  Of the record: the couplings that are fitted, then those that lie aside. To the board: the coupling whose serial number this is; 255: forgets one that lies aside.
 */
static inline uint8_t mavlink_msg_esea_life_get_number(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint8_t(msg,  212);
}

/**
 * @brief Get field couplings from esea_life message
 *
 * @return  How many the device has.
 */
static inline uint8_t mavlink_msg_esea_life_get_couplings(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint8_t(msg,  213);
}

/**
 * @brief Get field records from esea_life message
 *
 * @return  How many records there are.
 */
static inline uint8_t mavlink_msg_esea_life_get_records(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint8_t(msg,  214);
}

/**
 * @brief Get field result from esea_life message
 *
 * @return  Of naming the coupling.
 */
static inline uint8_t mavlink_msg_esea_life_get_result(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint8_t(msg,  215);
}

/**
 * @brief Decode a esea_life message into a struct
 *
 * @param msg The message to decode
 * @param esea_life C-struct to decode the message contents into
 */
static inline void mavlink_msg_esea_life_decode(const mavlink_message_t* msg, mavlink_esea_life_t* esea_life)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    esea_life->serial = mavlink_msg_esea_life_get_serial(msg);
    esea_life->seconds = mavlink_msg_esea_life_get_seconds(msg);
    esea_life->full = mavlink_msg_esea_life_get_full(msg);
    esea_life->energy_J = mavlink_msg_esea_life_get_energy_J(msg);
    esea_life->width_rad = mavlink_msg_esea_life_get_width_rad(msg);
    mavlink_msg_esea_life_get_halves(msg, esea_life->halves);
    esea_life->number = mavlink_msg_esea_life_get_number(msg);
    esea_life->couplings = mavlink_msg_esea_life_get_couplings(msg);
    esea_life->records = mavlink_msg_esea_life_get_records(msg);
    esea_life->result = mavlink_msg_esea_life_get_result(msg);
#else
        uint8_t len = msg->len < MAVLINK_MSG_ID_ESEA_LIFE_LEN? msg->len : MAVLINK_MSG_ID_ESEA_LIFE_LEN;
        memset(esea_life, 0, MAVLINK_MSG_ID_ESEA_LIFE_LEN);
    memcpy(esea_life, _MAV_PAYLOAD(msg), len);
#endif
}
