#pragma once
// MESSAGE ESEA_STAMP PACKING

#include <stdint.h>

#define MAVLINK_MSG_ID_ESEA_STAMP 42669


typedef struct __mavlink_esea_stamp_t {
 uint64_t signature; /*<  Timestamp that a signature must be above. To the board: 0.*/
 uint32_t boot; /*<  Number of this start of the board, never 0.*/
 uint32_t time_ms; /*< [ms] Device clock, at 0 again after 49.7 days.*/
} mavlink_esea_stamp_t;

#define MAVLINK_MSG_ID_ESEA_STAMP_LEN 16
#define MAVLINK_MSG_ID_ESEA_STAMP_MIN_LEN 16
#define MAVLINK_MSG_ID_42669_LEN 16
#define MAVLINK_MSG_ID_42669_MIN_LEN 16

#define MAVLINK_MSG_ID_ESEA_STAMP_CRC 226
#define MAVLINK_MSG_ID_42669_CRC 226



#if MAVLINK_COMMAND_24BIT
#define MAVLINK_MESSAGE_INFO_ESEA_STAMP { \
    42669, \
    "ESEA_STAMP", \
    3, \
    {  { "signature", NULL, MAVLINK_TYPE_UINT64_T, 0, 0, offsetof(mavlink_esea_stamp_t, signature) }, \
         { "boot", NULL, MAVLINK_TYPE_UINT32_T, 0, 8, offsetof(mavlink_esea_stamp_t, boot) }, \
         { "time_ms", NULL, MAVLINK_TYPE_UINT32_T, 0, 12, offsetof(mavlink_esea_stamp_t, time_ms) }, \
         } \
}
#else
#define MAVLINK_MESSAGE_INFO_ESEA_STAMP { \
    "ESEA_STAMP", \
    3, \
    {  { "signature", NULL, MAVLINK_TYPE_UINT64_T, 0, 0, offsetof(mavlink_esea_stamp_t, signature) }, \
         { "boot", NULL, MAVLINK_TYPE_UINT32_T, 0, 8, offsetof(mavlink_esea_stamp_t, boot) }, \
         { "time_ms", NULL, MAVLINK_TYPE_UINT32_T, 0, 12, offsetof(mavlink_esea_stamp_t, time_ms) }, \
         } \
}
#endif

/**
 * @brief Pack a esea_stamp message
 * @param system_id ID of this system
 * @param component_id ID of this component (e.g. 200 for IMU)
 * @param msg The MAVLink message to compress the data into
 *
 * @param signature  Timestamp that a signature must be above. To the board: 0.
 * @param boot  Number of this start of the board, never 0.
 * @param time_ms [ms] Device clock, at 0 again after 49.7 days.
 * @return length of the message in bytes (excluding serial stream start sign)
 */
static inline uint16_t mavlink_msg_esea_stamp_pack(uint8_t system_id, uint8_t component_id, mavlink_message_t* msg,
                               uint64_t signature, uint32_t boot, uint32_t time_ms)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    char buf[MAVLINK_MSG_ID_ESEA_STAMP_LEN];
    _mav_put_uint64_t(buf, 0, signature);
    _mav_put_uint32_t(buf, 8, boot);
    _mav_put_uint32_t(buf, 12, time_ms);

        memcpy(_MAV_PAYLOAD_NON_CONST(msg), buf, MAVLINK_MSG_ID_ESEA_STAMP_LEN);
#else
    mavlink_esea_stamp_t packet;
    packet.signature = signature;
    packet.boot = boot;
    packet.time_ms = time_ms;

        memcpy(_MAV_PAYLOAD_NON_CONST(msg), &packet, MAVLINK_MSG_ID_ESEA_STAMP_LEN);
#endif

    msg->msgid = MAVLINK_MSG_ID_ESEA_STAMP;
    return mavlink_finalize_message(msg, system_id, component_id, MAVLINK_MSG_ID_ESEA_STAMP_MIN_LEN, MAVLINK_MSG_ID_ESEA_STAMP_LEN, MAVLINK_MSG_ID_ESEA_STAMP_CRC);
}

/**
 * @brief Pack a esea_stamp message
 * @param system_id ID of this system
 * @param component_id ID of this component (e.g. 200 for IMU)
 * @param status MAVLink status structure
 * @param msg The MAVLink message to compress the data into
 *
 * @param signature  Timestamp that a signature must be above. To the board: 0.
 * @param boot  Number of this start of the board, never 0.
 * @param time_ms [ms] Device clock, at 0 again after 49.7 days.
 * @return length of the message in bytes (excluding serial stream start sign)
 */
static inline uint16_t mavlink_msg_esea_stamp_pack_status(uint8_t system_id, uint8_t component_id, mavlink_status_t *_status, mavlink_message_t* msg,
                               uint64_t signature, uint32_t boot, uint32_t time_ms)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    char buf[MAVLINK_MSG_ID_ESEA_STAMP_LEN];
    _mav_put_uint64_t(buf, 0, signature);
    _mav_put_uint32_t(buf, 8, boot);
    _mav_put_uint32_t(buf, 12, time_ms);

        memcpy(_MAV_PAYLOAD_NON_CONST(msg), buf, MAVLINK_MSG_ID_ESEA_STAMP_LEN);
#else
    mavlink_esea_stamp_t packet;
    packet.signature = signature;
    packet.boot = boot;
    packet.time_ms = time_ms;

        memcpy(_MAV_PAYLOAD_NON_CONST(msg), &packet, MAVLINK_MSG_ID_ESEA_STAMP_LEN);
#endif

    msg->msgid = MAVLINK_MSG_ID_ESEA_STAMP;
#if MAVLINK_CRC_EXTRA
    return mavlink_finalize_message_buffer(msg, system_id, component_id, _status, MAVLINK_MSG_ID_ESEA_STAMP_MIN_LEN, MAVLINK_MSG_ID_ESEA_STAMP_LEN, MAVLINK_MSG_ID_ESEA_STAMP_CRC);
#else
    return mavlink_finalize_message_buffer(msg, system_id, component_id, _status, MAVLINK_MSG_ID_ESEA_STAMP_MIN_LEN, MAVLINK_MSG_ID_ESEA_STAMP_LEN);
#endif
}

/**
 * @brief Pack a esea_stamp message on a channel
 * @param system_id ID of this system
 * @param component_id ID of this component (e.g. 200 for IMU)
 * @param chan The MAVLink channel this message will be sent over
 * @param msg The MAVLink message to compress the data into
 * @param signature  Timestamp that a signature must be above. To the board: 0.
 * @param boot  Number of this start of the board, never 0.
 * @param time_ms [ms] Device clock, at 0 again after 49.7 days.
 * @return length of the message in bytes (excluding serial stream start sign)
 */
static inline uint16_t mavlink_msg_esea_stamp_pack_chan(uint8_t system_id, uint8_t component_id, uint8_t chan,
                               mavlink_message_t* msg,
                                   uint64_t signature,uint32_t boot,uint32_t time_ms)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    char buf[MAVLINK_MSG_ID_ESEA_STAMP_LEN];
    _mav_put_uint64_t(buf, 0, signature);
    _mav_put_uint32_t(buf, 8, boot);
    _mav_put_uint32_t(buf, 12, time_ms);

        memcpy(_MAV_PAYLOAD_NON_CONST(msg), buf, MAVLINK_MSG_ID_ESEA_STAMP_LEN);
#else
    mavlink_esea_stamp_t packet;
    packet.signature = signature;
    packet.boot = boot;
    packet.time_ms = time_ms;

        memcpy(_MAV_PAYLOAD_NON_CONST(msg), &packet, MAVLINK_MSG_ID_ESEA_STAMP_LEN);
#endif

    msg->msgid = MAVLINK_MSG_ID_ESEA_STAMP;
    return mavlink_finalize_message_chan(msg, system_id, component_id, chan, MAVLINK_MSG_ID_ESEA_STAMP_MIN_LEN, MAVLINK_MSG_ID_ESEA_STAMP_LEN, MAVLINK_MSG_ID_ESEA_STAMP_CRC);
}

/**
 * @brief Encode a esea_stamp struct
 *
 * @param system_id ID of this system
 * @param component_id ID of this component (e.g. 200 for IMU)
 * @param msg The MAVLink message to compress the data into
 * @param esea_stamp C-struct to read the message contents from
 */
static inline uint16_t mavlink_msg_esea_stamp_encode(uint8_t system_id, uint8_t component_id, mavlink_message_t* msg, const mavlink_esea_stamp_t* esea_stamp)
{
    return mavlink_msg_esea_stamp_pack(system_id, component_id, msg, esea_stamp->signature, esea_stamp->boot, esea_stamp->time_ms);
}

/**
 * @brief Encode a esea_stamp struct on a channel
 *
 * @param system_id ID of this system
 * @param component_id ID of this component (e.g. 200 for IMU)
 * @param chan The MAVLink channel this message will be sent over
 * @param msg The MAVLink message to compress the data into
 * @param esea_stamp C-struct to read the message contents from
 */
static inline uint16_t mavlink_msg_esea_stamp_encode_chan(uint8_t system_id, uint8_t component_id, uint8_t chan, mavlink_message_t* msg, const mavlink_esea_stamp_t* esea_stamp)
{
    return mavlink_msg_esea_stamp_pack_chan(system_id, component_id, chan, msg, esea_stamp->signature, esea_stamp->boot, esea_stamp->time_ms);
}

/**
 * @brief Encode a esea_stamp struct with provided status structure
 *
 * @param system_id ID of this system
 * @param component_id ID of this component (e.g. 200 for IMU)
 * @param status MAVLink status structure
 * @param msg The MAVLink message to compress the data into
 * @param esea_stamp C-struct to read the message contents from
 */
static inline uint16_t mavlink_msg_esea_stamp_encode_status(uint8_t system_id, uint8_t component_id, mavlink_status_t* _status, mavlink_message_t* msg, const mavlink_esea_stamp_t* esea_stamp)
{
    return mavlink_msg_esea_stamp_pack_status(system_id, component_id, _status, msg,  esea_stamp->signature, esea_stamp->boot, esea_stamp->time_ms);
}

/**
 * @brief Send a esea_stamp message
 * @param chan MAVLink channel to send the message
 *
 * @param signature  Timestamp that a signature must be above. To the board: 0.
 * @param boot  Number of this start of the board, never 0.
 * @param time_ms [ms] Device clock, at 0 again after 49.7 days.
 */
#ifdef MAVLINK_USE_CONVENIENCE_FUNCTIONS

static inline void mavlink_msg_esea_stamp_send(mavlink_channel_t chan, uint64_t signature, uint32_t boot, uint32_t time_ms)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    char buf[MAVLINK_MSG_ID_ESEA_STAMP_LEN];
    _mav_put_uint64_t(buf, 0, signature);
    _mav_put_uint32_t(buf, 8, boot);
    _mav_put_uint32_t(buf, 12, time_ms);

    _mav_finalize_message_chan_send(chan, MAVLINK_MSG_ID_ESEA_STAMP, buf, MAVLINK_MSG_ID_ESEA_STAMP_MIN_LEN, MAVLINK_MSG_ID_ESEA_STAMP_LEN, MAVLINK_MSG_ID_ESEA_STAMP_CRC);
#else
    mavlink_esea_stamp_t packet;
    packet.signature = signature;
    packet.boot = boot;
    packet.time_ms = time_ms;

    _mav_finalize_message_chan_send(chan, MAVLINK_MSG_ID_ESEA_STAMP, (const char *)&packet, MAVLINK_MSG_ID_ESEA_STAMP_MIN_LEN, MAVLINK_MSG_ID_ESEA_STAMP_LEN, MAVLINK_MSG_ID_ESEA_STAMP_CRC);
#endif
}

/**
 * @brief Send a esea_stamp message
 * @param chan MAVLink channel to send the message
 * @param struct The MAVLink struct to serialize
 */
static inline void mavlink_msg_esea_stamp_send_struct(mavlink_channel_t chan, const mavlink_esea_stamp_t* esea_stamp)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    mavlink_msg_esea_stamp_send(chan, esea_stamp->signature, esea_stamp->boot, esea_stamp->time_ms);
#else
    _mav_finalize_message_chan_send(chan, MAVLINK_MSG_ID_ESEA_STAMP, (const char *)esea_stamp, MAVLINK_MSG_ID_ESEA_STAMP_MIN_LEN, MAVLINK_MSG_ID_ESEA_STAMP_LEN, MAVLINK_MSG_ID_ESEA_STAMP_CRC);
#endif
}

#if MAVLINK_MSG_ID_ESEA_STAMP_LEN <= MAVLINK_MAX_PAYLOAD_LEN
/*
  This variant of _send() can be used to save stack space by reusing
  memory from the receive buffer.  The caller provides a
  mavlink_message_t which is the size of a full mavlink message. This
  is usually the receive buffer for the channel, and allows a reply to an
  incoming message with minimum stack space usage.
 */
static inline void mavlink_msg_esea_stamp_send_buf(mavlink_message_t *msgbuf, mavlink_channel_t chan,  uint64_t signature, uint32_t boot, uint32_t time_ms)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    char *buf = (char *)msgbuf;
    _mav_put_uint64_t(buf, 0, signature);
    _mav_put_uint32_t(buf, 8, boot);
    _mav_put_uint32_t(buf, 12, time_ms);

    _mav_finalize_message_chan_send(chan, MAVLINK_MSG_ID_ESEA_STAMP, buf, MAVLINK_MSG_ID_ESEA_STAMP_MIN_LEN, MAVLINK_MSG_ID_ESEA_STAMP_LEN, MAVLINK_MSG_ID_ESEA_STAMP_CRC);
#else
    mavlink_esea_stamp_t *packet = (mavlink_esea_stamp_t *)msgbuf;
    packet->signature = signature;
    packet->boot = boot;
    packet->time_ms = time_ms;

    _mav_finalize_message_chan_send(chan, MAVLINK_MSG_ID_ESEA_STAMP, (const char *)packet, MAVLINK_MSG_ID_ESEA_STAMP_MIN_LEN, MAVLINK_MSG_ID_ESEA_STAMP_LEN, MAVLINK_MSG_ID_ESEA_STAMP_CRC);
#endif
}
#endif

#endif

// MESSAGE ESEA_STAMP UNPACKING


/**
 * @brief Get field signature from esea_stamp message
 *
 * @return  Timestamp that a signature must be above. To the board: 0.
 */
static inline uint64_t mavlink_msg_esea_stamp_get_signature(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint64_t(msg,  0);
}

/**
 * @brief Get field boot from esea_stamp message
 *
 * @return  Number of this start of the board, never 0.
 */
static inline uint32_t mavlink_msg_esea_stamp_get_boot(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint32_t(msg,  8);
}

/**
 * @brief Get field time_ms from esea_stamp message
 *
 * @return [ms] Device clock, at 0 again after 49.7 days.
 */
static inline uint32_t mavlink_msg_esea_stamp_get_time_ms(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint32_t(msg,  12);
}

/**
 * @brief Decode a esea_stamp message into a struct
 *
 * @param msg The message to decode
 * @param esea_stamp C-struct to decode the message contents into
 */
static inline void mavlink_msg_esea_stamp_decode(const mavlink_message_t* msg, mavlink_esea_stamp_t* esea_stamp)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    esea_stamp->signature = mavlink_msg_esea_stamp_get_signature(msg);
    esea_stamp->boot = mavlink_msg_esea_stamp_get_boot(msg);
    esea_stamp->time_ms = mavlink_msg_esea_stamp_get_time_ms(msg);
#else
        uint8_t len = msg->len < MAVLINK_MSG_ID_ESEA_STAMP_LEN? msg->len : MAVLINK_MSG_ID_ESEA_STAMP_LEN;
        memset(esea_stamp, 0, MAVLINK_MSG_ID_ESEA_STAMP_LEN);
    memcpy(esea_stamp, _MAV_PAYLOAD(msg), len);
#endif
}
