#pragma once
// MESSAGE ESEA_TRAFFIC PACKING

#include <stdint.h>

#define MAVLINK_MSG_ID_ESEA_TRAFFIC 42664


typedef struct __mavlink_esea_traffic_t {
 uint32_t stream_messages; /*<  Messages of streams since power-on, filled.*/
 uint32_t stream_dropped; /*<  Messages of streams that found no room and were left out.*/
 uint32_t paired; /*<  1: only signed commands are taken, beside STOP.*/
 uint32_t unsigned_refused; /*<  Frames without a signature that needed one.*/
 uint32_t bad_signatures; /*<  Frames whose signature was wrong.*/
 uint32_t replayed; /*<  Frames whose signature was good, but old or far ahead.*/
 uint32_t parameters_refused; /*<  Parameters that were not set.*/
 uint32_t expired; /*<  Commands that came too late, or without their time.*/
} mavlink_esea_traffic_t;

#define MAVLINK_MSG_ID_ESEA_TRAFFIC_LEN 32
#define MAVLINK_MSG_ID_ESEA_TRAFFIC_MIN_LEN 32
#define MAVLINK_MSG_ID_42664_LEN 32
#define MAVLINK_MSG_ID_42664_MIN_LEN 32

#define MAVLINK_MSG_ID_ESEA_TRAFFIC_CRC 102
#define MAVLINK_MSG_ID_42664_CRC 102



#if MAVLINK_COMMAND_24BIT
#define MAVLINK_MESSAGE_INFO_ESEA_TRAFFIC { \
    42664, \
    "ESEA_TRAFFIC", \
    8, \
    {  { "stream_messages", NULL, MAVLINK_TYPE_UINT32_T, 0, 0, offsetof(mavlink_esea_traffic_t, stream_messages) }, \
         { "stream_dropped", NULL, MAVLINK_TYPE_UINT32_T, 0, 4, offsetof(mavlink_esea_traffic_t, stream_dropped) }, \
         { "paired", NULL, MAVLINK_TYPE_UINT32_T, 0, 8, offsetof(mavlink_esea_traffic_t, paired) }, \
         { "unsigned_refused", NULL, MAVLINK_TYPE_UINT32_T, 0, 12, offsetof(mavlink_esea_traffic_t, unsigned_refused) }, \
         { "bad_signatures", NULL, MAVLINK_TYPE_UINT32_T, 0, 16, offsetof(mavlink_esea_traffic_t, bad_signatures) }, \
         { "replayed", NULL, MAVLINK_TYPE_UINT32_T, 0, 20, offsetof(mavlink_esea_traffic_t, replayed) }, \
         { "parameters_refused", NULL, MAVLINK_TYPE_UINT32_T, 0, 24, offsetof(mavlink_esea_traffic_t, parameters_refused) }, \
         { "expired", NULL, MAVLINK_TYPE_UINT32_T, 0, 28, offsetof(mavlink_esea_traffic_t, expired) }, \
         } \
}
#else
#define MAVLINK_MESSAGE_INFO_ESEA_TRAFFIC { \
    "ESEA_TRAFFIC", \
    8, \
    {  { "stream_messages", NULL, MAVLINK_TYPE_UINT32_T, 0, 0, offsetof(mavlink_esea_traffic_t, stream_messages) }, \
         { "stream_dropped", NULL, MAVLINK_TYPE_UINT32_T, 0, 4, offsetof(mavlink_esea_traffic_t, stream_dropped) }, \
         { "paired", NULL, MAVLINK_TYPE_UINT32_T, 0, 8, offsetof(mavlink_esea_traffic_t, paired) }, \
         { "unsigned_refused", NULL, MAVLINK_TYPE_UINT32_T, 0, 12, offsetof(mavlink_esea_traffic_t, unsigned_refused) }, \
         { "bad_signatures", NULL, MAVLINK_TYPE_UINT32_T, 0, 16, offsetof(mavlink_esea_traffic_t, bad_signatures) }, \
         { "replayed", NULL, MAVLINK_TYPE_UINT32_T, 0, 20, offsetof(mavlink_esea_traffic_t, replayed) }, \
         { "parameters_refused", NULL, MAVLINK_TYPE_UINT32_T, 0, 24, offsetof(mavlink_esea_traffic_t, parameters_refused) }, \
         { "expired", NULL, MAVLINK_TYPE_UINT32_T, 0, 28, offsetof(mavlink_esea_traffic_t, expired) }, \
         } \
}
#endif

/**
 * @brief Pack a esea_traffic message
 * @param system_id ID of this system
 * @param component_id ID of this component (e.g. 200 for IMU)
 * @param msg The MAVLink message to compress the data into
 *
 * @param stream_messages  Messages of streams since power-on, filled.
 * @param stream_dropped  Messages of streams that found no room and were left out.
 * @param paired  1: only signed commands are taken, beside STOP.
 * @param unsigned_refused  Frames without a signature that needed one.
 * @param bad_signatures  Frames whose signature was wrong.
 * @param replayed  Frames whose signature was good, but old or far ahead.
 * @param parameters_refused  Parameters that were not set.
 * @param expired  Commands that came too late, or without their time.
 * @return length of the message in bytes (excluding serial stream start sign)
 */
static inline uint16_t mavlink_msg_esea_traffic_pack(uint8_t system_id, uint8_t component_id, mavlink_message_t* msg,
                               uint32_t stream_messages, uint32_t stream_dropped, uint32_t paired, uint32_t unsigned_refused, uint32_t bad_signatures, uint32_t replayed, uint32_t parameters_refused, uint32_t expired)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    char buf[MAVLINK_MSG_ID_ESEA_TRAFFIC_LEN];
    _mav_put_uint32_t(buf, 0, stream_messages);
    _mav_put_uint32_t(buf, 4, stream_dropped);
    _mav_put_uint32_t(buf, 8, paired);
    _mav_put_uint32_t(buf, 12, unsigned_refused);
    _mav_put_uint32_t(buf, 16, bad_signatures);
    _mav_put_uint32_t(buf, 20, replayed);
    _mav_put_uint32_t(buf, 24, parameters_refused);
    _mav_put_uint32_t(buf, 28, expired);

        memcpy(_MAV_PAYLOAD_NON_CONST(msg), buf, MAVLINK_MSG_ID_ESEA_TRAFFIC_LEN);
#else
    mavlink_esea_traffic_t packet;
    packet.stream_messages = stream_messages;
    packet.stream_dropped = stream_dropped;
    packet.paired = paired;
    packet.unsigned_refused = unsigned_refused;
    packet.bad_signatures = bad_signatures;
    packet.replayed = replayed;
    packet.parameters_refused = parameters_refused;
    packet.expired = expired;

        memcpy(_MAV_PAYLOAD_NON_CONST(msg), &packet, MAVLINK_MSG_ID_ESEA_TRAFFIC_LEN);
#endif

    msg->msgid = MAVLINK_MSG_ID_ESEA_TRAFFIC;
    return mavlink_finalize_message(msg, system_id, component_id, MAVLINK_MSG_ID_ESEA_TRAFFIC_MIN_LEN, MAVLINK_MSG_ID_ESEA_TRAFFIC_LEN, MAVLINK_MSG_ID_ESEA_TRAFFIC_CRC);
}

/**
 * @brief Pack a esea_traffic message
 * @param system_id ID of this system
 * @param component_id ID of this component (e.g. 200 for IMU)
 * @param status MAVLink status structure
 * @param msg The MAVLink message to compress the data into
 *
 * @param stream_messages  Messages of streams since power-on, filled.
 * @param stream_dropped  Messages of streams that found no room and were left out.
 * @param paired  1: only signed commands are taken, beside STOP.
 * @param unsigned_refused  Frames without a signature that needed one.
 * @param bad_signatures  Frames whose signature was wrong.
 * @param replayed  Frames whose signature was good, but old or far ahead.
 * @param parameters_refused  Parameters that were not set.
 * @param expired  Commands that came too late, or without their time.
 * @return length of the message in bytes (excluding serial stream start sign)
 */
static inline uint16_t mavlink_msg_esea_traffic_pack_status(uint8_t system_id, uint8_t component_id, mavlink_status_t *_status, mavlink_message_t* msg,
                               uint32_t stream_messages, uint32_t stream_dropped, uint32_t paired, uint32_t unsigned_refused, uint32_t bad_signatures, uint32_t replayed, uint32_t parameters_refused, uint32_t expired)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    char buf[MAVLINK_MSG_ID_ESEA_TRAFFIC_LEN];
    _mav_put_uint32_t(buf, 0, stream_messages);
    _mav_put_uint32_t(buf, 4, stream_dropped);
    _mav_put_uint32_t(buf, 8, paired);
    _mav_put_uint32_t(buf, 12, unsigned_refused);
    _mav_put_uint32_t(buf, 16, bad_signatures);
    _mav_put_uint32_t(buf, 20, replayed);
    _mav_put_uint32_t(buf, 24, parameters_refused);
    _mav_put_uint32_t(buf, 28, expired);

        memcpy(_MAV_PAYLOAD_NON_CONST(msg), buf, MAVLINK_MSG_ID_ESEA_TRAFFIC_LEN);
#else
    mavlink_esea_traffic_t packet;
    packet.stream_messages = stream_messages;
    packet.stream_dropped = stream_dropped;
    packet.paired = paired;
    packet.unsigned_refused = unsigned_refused;
    packet.bad_signatures = bad_signatures;
    packet.replayed = replayed;
    packet.parameters_refused = parameters_refused;
    packet.expired = expired;

        memcpy(_MAV_PAYLOAD_NON_CONST(msg), &packet, MAVLINK_MSG_ID_ESEA_TRAFFIC_LEN);
#endif

    msg->msgid = MAVLINK_MSG_ID_ESEA_TRAFFIC;
#if MAVLINK_CRC_EXTRA
    return mavlink_finalize_message_buffer(msg, system_id, component_id, _status, MAVLINK_MSG_ID_ESEA_TRAFFIC_MIN_LEN, MAVLINK_MSG_ID_ESEA_TRAFFIC_LEN, MAVLINK_MSG_ID_ESEA_TRAFFIC_CRC);
#else
    return mavlink_finalize_message_buffer(msg, system_id, component_id, _status, MAVLINK_MSG_ID_ESEA_TRAFFIC_MIN_LEN, MAVLINK_MSG_ID_ESEA_TRAFFIC_LEN);
#endif
}

/**
 * @brief Pack a esea_traffic message on a channel
 * @param system_id ID of this system
 * @param component_id ID of this component (e.g. 200 for IMU)
 * @param chan The MAVLink channel this message will be sent over
 * @param msg The MAVLink message to compress the data into
 * @param stream_messages  Messages of streams since power-on, filled.
 * @param stream_dropped  Messages of streams that found no room and were left out.
 * @param paired  1: only signed commands are taken, beside STOP.
 * @param unsigned_refused  Frames without a signature that needed one.
 * @param bad_signatures  Frames whose signature was wrong.
 * @param replayed  Frames whose signature was good, but old or far ahead.
 * @param parameters_refused  Parameters that were not set.
 * @param expired  Commands that came too late, or without their time.
 * @return length of the message in bytes (excluding serial stream start sign)
 */
static inline uint16_t mavlink_msg_esea_traffic_pack_chan(uint8_t system_id, uint8_t component_id, uint8_t chan,
                               mavlink_message_t* msg,
                                   uint32_t stream_messages,uint32_t stream_dropped,uint32_t paired,uint32_t unsigned_refused,uint32_t bad_signatures,uint32_t replayed,uint32_t parameters_refused,uint32_t expired)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    char buf[MAVLINK_MSG_ID_ESEA_TRAFFIC_LEN];
    _mav_put_uint32_t(buf, 0, stream_messages);
    _mav_put_uint32_t(buf, 4, stream_dropped);
    _mav_put_uint32_t(buf, 8, paired);
    _mav_put_uint32_t(buf, 12, unsigned_refused);
    _mav_put_uint32_t(buf, 16, bad_signatures);
    _mav_put_uint32_t(buf, 20, replayed);
    _mav_put_uint32_t(buf, 24, parameters_refused);
    _mav_put_uint32_t(buf, 28, expired);

        memcpy(_MAV_PAYLOAD_NON_CONST(msg), buf, MAVLINK_MSG_ID_ESEA_TRAFFIC_LEN);
#else
    mavlink_esea_traffic_t packet;
    packet.stream_messages = stream_messages;
    packet.stream_dropped = stream_dropped;
    packet.paired = paired;
    packet.unsigned_refused = unsigned_refused;
    packet.bad_signatures = bad_signatures;
    packet.replayed = replayed;
    packet.parameters_refused = parameters_refused;
    packet.expired = expired;

        memcpy(_MAV_PAYLOAD_NON_CONST(msg), &packet, MAVLINK_MSG_ID_ESEA_TRAFFIC_LEN);
#endif

    msg->msgid = MAVLINK_MSG_ID_ESEA_TRAFFIC;
    return mavlink_finalize_message_chan(msg, system_id, component_id, chan, MAVLINK_MSG_ID_ESEA_TRAFFIC_MIN_LEN, MAVLINK_MSG_ID_ESEA_TRAFFIC_LEN, MAVLINK_MSG_ID_ESEA_TRAFFIC_CRC);
}

/**
 * @brief Encode a esea_traffic struct
 *
 * @param system_id ID of this system
 * @param component_id ID of this component (e.g. 200 for IMU)
 * @param msg The MAVLink message to compress the data into
 * @param esea_traffic C-struct to read the message contents from
 */
static inline uint16_t mavlink_msg_esea_traffic_encode(uint8_t system_id, uint8_t component_id, mavlink_message_t* msg, const mavlink_esea_traffic_t* esea_traffic)
{
    return mavlink_msg_esea_traffic_pack(system_id, component_id, msg, esea_traffic->stream_messages, esea_traffic->stream_dropped, esea_traffic->paired, esea_traffic->unsigned_refused, esea_traffic->bad_signatures, esea_traffic->replayed, esea_traffic->parameters_refused, esea_traffic->expired);
}

/**
 * @brief Encode a esea_traffic struct on a channel
 *
 * @param system_id ID of this system
 * @param component_id ID of this component (e.g. 200 for IMU)
 * @param chan The MAVLink channel this message will be sent over
 * @param msg The MAVLink message to compress the data into
 * @param esea_traffic C-struct to read the message contents from
 */
static inline uint16_t mavlink_msg_esea_traffic_encode_chan(uint8_t system_id, uint8_t component_id, uint8_t chan, mavlink_message_t* msg, const mavlink_esea_traffic_t* esea_traffic)
{
    return mavlink_msg_esea_traffic_pack_chan(system_id, component_id, chan, msg, esea_traffic->stream_messages, esea_traffic->stream_dropped, esea_traffic->paired, esea_traffic->unsigned_refused, esea_traffic->bad_signatures, esea_traffic->replayed, esea_traffic->parameters_refused, esea_traffic->expired);
}

/**
 * @brief Encode a esea_traffic struct with provided status structure
 *
 * @param system_id ID of this system
 * @param component_id ID of this component (e.g. 200 for IMU)
 * @param status MAVLink status structure
 * @param msg The MAVLink message to compress the data into
 * @param esea_traffic C-struct to read the message contents from
 */
static inline uint16_t mavlink_msg_esea_traffic_encode_status(uint8_t system_id, uint8_t component_id, mavlink_status_t* _status, mavlink_message_t* msg, const mavlink_esea_traffic_t* esea_traffic)
{
    return mavlink_msg_esea_traffic_pack_status(system_id, component_id, _status, msg,  esea_traffic->stream_messages, esea_traffic->stream_dropped, esea_traffic->paired, esea_traffic->unsigned_refused, esea_traffic->bad_signatures, esea_traffic->replayed, esea_traffic->parameters_refused, esea_traffic->expired);
}

/**
 * @brief Send a esea_traffic message
 * @param chan MAVLink channel to send the message
 *
 * @param stream_messages  Messages of streams since power-on, filled.
 * @param stream_dropped  Messages of streams that found no room and were left out.
 * @param paired  1: only signed commands are taken, beside STOP.
 * @param unsigned_refused  Frames without a signature that needed one.
 * @param bad_signatures  Frames whose signature was wrong.
 * @param replayed  Frames whose signature was good, but old or far ahead.
 * @param parameters_refused  Parameters that were not set.
 * @param expired  Commands that came too late, or without their time.
 */
#ifdef MAVLINK_USE_CONVENIENCE_FUNCTIONS

static inline void mavlink_msg_esea_traffic_send(mavlink_channel_t chan, uint32_t stream_messages, uint32_t stream_dropped, uint32_t paired, uint32_t unsigned_refused, uint32_t bad_signatures, uint32_t replayed, uint32_t parameters_refused, uint32_t expired)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    char buf[MAVLINK_MSG_ID_ESEA_TRAFFIC_LEN];
    _mav_put_uint32_t(buf, 0, stream_messages);
    _mav_put_uint32_t(buf, 4, stream_dropped);
    _mav_put_uint32_t(buf, 8, paired);
    _mav_put_uint32_t(buf, 12, unsigned_refused);
    _mav_put_uint32_t(buf, 16, bad_signatures);
    _mav_put_uint32_t(buf, 20, replayed);
    _mav_put_uint32_t(buf, 24, parameters_refused);
    _mav_put_uint32_t(buf, 28, expired);

    _mav_finalize_message_chan_send(chan, MAVLINK_MSG_ID_ESEA_TRAFFIC, buf, MAVLINK_MSG_ID_ESEA_TRAFFIC_MIN_LEN, MAVLINK_MSG_ID_ESEA_TRAFFIC_LEN, MAVLINK_MSG_ID_ESEA_TRAFFIC_CRC);
#else
    mavlink_esea_traffic_t packet;
    packet.stream_messages = stream_messages;
    packet.stream_dropped = stream_dropped;
    packet.paired = paired;
    packet.unsigned_refused = unsigned_refused;
    packet.bad_signatures = bad_signatures;
    packet.replayed = replayed;
    packet.parameters_refused = parameters_refused;
    packet.expired = expired;

    _mav_finalize_message_chan_send(chan, MAVLINK_MSG_ID_ESEA_TRAFFIC, (const char *)&packet, MAVLINK_MSG_ID_ESEA_TRAFFIC_MIN_LEN, MAVLINK_MSG_ID_ESEA_TRAFFIC_LEN, MAVLINK_MSG_ID_ESEA_TRAFFIC_CRC);
#endif
}

/**
 * @brief Send a esea_traffic message
 * @param chan MAVLink channel to send the message
 * @param struct The MAVLink struct to serialize
 */
static inline void mavlink_msg_esea_traffic_send_struct(mavlink_channel_t chan, const mavlink_esea_traffic_t* esea_traffic)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    mavlink_msg_esea_traffic_send(chan, esea_traffic->stream_messages, esea_traffic->stream_dropped, esea_traffic->paired, esea_traffic->unsigned_refused, esea_traffic->bad_signatures, esea_traffic->replayed, esea_traffic->parameters_refused, esea_traffic->expired);
#else
    _mav_finalize_message_chan_send(chan, MAVLINK_MSG_ID_ESEA_TRAFFIC, (const char *)esea_traffic, MAVLINK_MSG_ID_ESEA_TRAFFIC_MIN_LEN, MAVLINK_MSG_ID_ESEA_TRAFFIC_LEN, MAVLINK_MSG_ID_ESEA_TRAFFIC_CRC);
#endif
}

#if MAVLINK_MSG_ID_ESEA_TRAFFIC_LEN <= MAVLINK_MAX_PAYLOAD_LEN
/*
  This variant of _send() can be used to save stack space by reusing
  memory from the receive buffer.  The caller provides a
  mavlink_message_t which is the size of a full mavlink message. This
  is usually the receive buffer for the channel, and allows a reply to an
  incoming message with minimum stack space usage.
 */
static inline void mavlink_msg_esea_traffic_send_buf(mavlink_message_t *msgbuf, mavlink_channel_t chan,  uint32_t stream_messages, uint32_t stream_dropped, uint32_t paired, uint32_t unsigned_refused, uint32_t bad_signatures, uint32_t replayed, uint32_t parameters_refused, uint32_t expired)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    char *buf = (char *)msgbuf;
    _mav_put_uint32_t(buf, 0, stream_messages);
    _mav_put_uint32_t(buf, 4, stream_dropped);
    _mav_put_uint32_t(buf, 8, paired);
    _mav_put_uint32_t(buf, 12, unsigned_refused);
    _mav_put_uint32_t(buf, 16, bad_signatures);
    _mav_put_uint32_t(buf, 20, replayed);
    _mav_put_uint32_t(buf, 24, parameters_refused);
    _mav_put_uint32_t(buf, 28, expired);

    _mav_finalize_message_chan_send(chan, MAVLINK_MSG_ID_ESEA_TRAFFIC, buf, MAVLINK_MSG_ID_ESEA_TRAFFIC_MIN_LEN, MAVLINK_MSG_ID_ESEA_TRAFFIC_LEN, MAVLINK_MSG_ID_ESEA_TRAFFIC_CRC);
#else
    mavlink_esea_traffic_t *packet = (mavlink_esea_traffic_t *)msgbuf;
    packet->stream_messages = stream_messages;
    packet->stream_dropped = stream_dropped;
    packet->paired = paired;
    packet->unsigned_refused = unsigned_refused;
    packet->bad_signatures = bad_signatures;
    packet->replayed = replayed;
    packet->parameters_refused = parameters_refused;
    packet->expired = expired;

    _mav_finalize_message_chan_send(chan, MAVLINK_MSG_ID_ESEA_TRAFFIC, (const char *)packet, MAVLINK_MSG_ID_ESEA_TRAFFIC_MIN_LEN, MAVLINK_MSG_ID_ESEA_TRAFFIC_LEN, MAVLINK_MSG_ID_ESEA_TRAFFIC_CRC);
#endif
}
#endif

#endif

// MESSAGE ESEA_TRAFFIC UNPACKING


/**
 * @brief Get field stream_messages from esea_traffic message
 *
 * @return  Messages of streams since power-on, filled.
 */
static inline uint32_t mavlink_msg_esea_traffic_get_stream_messages(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint32_t(msg,  0);
}

/**
 * @brief Get field stream_dropped from esea_traffic message
 *
 * @return  Messages of streams that found no room and were left out.
 */
static inline uint32_t mavlink_msg_esea_traffic_get_stream_dropped(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint32_t(msg,  4);
}

/**
 * @brief Get field paired from esea_traffic message
 *
 * @return  1: only signed commands are taken, beside STOP.
 */
static inline uint32_t mavlink_msg_esea_traffic_get_paired(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint32_t(msg,  8);
}

/**
 * @brief Get field unsigned_refused from esea_traffic message
 *
 * @return  Frames without a signature that needed one.
 */
static inline uint32_t mavlink_msg_esea_traffic_get_unsigned_refused(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint32_t(msg,  12);
}

/**
 * @brief Get field bad_signatures from esea_traffic message
 *
 * @return  Frames whose signature was wrong.
 */
static inline uint32_t mavlink_msg_esea_traffic_get_bad_signatures(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint32_t(msg,  16);
}

/**
 * @brief Get field replayed from esea_traffic message
 *
 * @return  Frames whose signature was good, but old or far ahead.
 */
static inline uint32_t mavlink_msg_esea_traffic_get_replayed(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint32_t(msg,  20);
}

/**
 * @brief Get field parameters_refused from esea_traffic message
 *
 * @return  Parameters that were not set.
 */
static inline uint32_t mavlink_msg_esea_traffic_get_parameters_refused(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint32_t(msg,  24);
}

/**
 * @brief Get field expired from esea_traffic message
 *
 * @return  Commands that came too late, or without their time.
 */
static inline uint32_t mavlink_msg_esea_traffic_get_expired(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint32_t(msg,  28);
}

/**
 * @brief Decode a esea_traffic message into a struct
 *
 * @param msg The message to decode
 * @param esea_traffic C-struct to decode the message contents into
 */
static inline void mavlink_msg_esea_traffic_decode(const mavlink_message_t* msg, mavlink_esea_traffic_t* esea_traffic)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    esea_traffic->stream_messages = mavlink_msg_esea_traffic_get_stream_messages(msg);
    esea_traffic->stream_dropped = mavlink_msg_esea_traffic_get_stream_dropped(msg);
    esea_traffic->paired = mavlink_msg_esea_traffic_get_paired(msg);
    esea_traffic->unsigned_refused = mavlink_msg_esea_traffic_get_unsigned_refused(msg);
    esea_traffic->bad_signatures = mavlink_msg_esea_traffic_get_bad_signatures(msg);
    esea_traffic->replayed = mavlink_msg_esea_traffic_get_replayed(msg);
    esea_traffic->parameters_refused = mavlink_msg_esea_traffic_get_parameters_refused(msg);
    esea_traffic->expired = mavlink_msg_esea_traffic_get_expired(msg);
#else
        uint8_t len = msg->len < MAVLINK_MSG_ID_ESEA_TRAFFIC_LEN? msg->len : MAVLINK_MSG_ID_ESEA_TRAFFIC_LEN;
        memset(esea_traffic, 0, MAVLINK_MSG_ID_ESEA_TRAFFIC_LEN);
    memcpy(esea_traffic, _MAV_PAYLOAD(msg), len);
#endif
}
