#pragma once
// MESSAGE ESEA_KEY PACKING

#include <stdint.h>

#define MAVLINK_MSG_ID_ESEA_KEY 42665


typedef struct __mavlink_esea_key_t {
 uint32_t sequence; /*<  Base tick at whose start it was taken.*/
 uint32_t first; /*<  Number of the first word here.*/
 uint32_t total; /*<  Words of the whole frame: params, then state, as in the C.*/
 uint32_t words[58]; /*<  As they lie in memory; 0 behind the last.*/
} mavlink_esea_key_t;

#define MAVLINK_MSG_ID_ESEA_KEY_LEN 244
#define MAVLINK_MSG_ID_ESEA_KEY_MIN_LEN 244
#define MAVLINK_MSG_ID_42665_LEN 244
#define MAVLINK_MSG_ID_42665_MIN_LEN 244

#define MAVLINK_MSG_ID_ESEA_KEY_CRC 247
#define MAVLINK_MSG_ID_42665_CRC 247

#define MAVLINK_MSG_ESEA_KEY_FIELD_WORDS_LEN 58

#if MAVLINK_COMMAND_24BIT
#define MAVLINK_MESSAGE_INFO_ESEA_KEY { \
    42665, \
    "ESEA_KEY", \
    4, \
    {  { "sequence", NULL, MAVLINK_TYPE_UINT32_T, 0, 0, offsetof(mavlink_esea_key_t, sequence) }, \
         { "first", NULL, MAVLINK_TYPE_UINT32_T, 0, 4, offsetof(mavlink_esea_key_t, first) }, \
         { "total", NULL, MAVLINK_TYPE_UINT32_T, 0, 8, offsetof(mavlink_esea_key_t, total) }, \
         { "words", NULL, MAVLINK_TYPE_UINT32_T, 58, 12, offsetof(mavlink_esea_key_t, words) }, \
         } \
}
#else
#define MAVLINK_MESSAGE_INFO_ESEA_KEY { \
    "ESEA_KEY", \
    4, \
    {  { "sequence", NULL, MAVLINK_TYPE_UINT32_T, 0, 0, offsetof(mavlink_esea_key_t, sequence) }, \
         { "first", NULL, MAVLINK_TYPE_UINT32_T, 0, 4, offsetof(mavlink_esea_key_t, first) }, \
         { "total", NULL, MAVLINK_TYPE_UINT32_T, 0, 8, offsetof(mavlink_esea_key_t, total) }, \
         { "words", NULL, MAVLINK_TYPE_UINT32_T, 58, 12, offsetof(mavlink_esea_key_t, words) }, \
         } \
}
#endif

/**
 * @brief Pack a esea_key message
 * @param system_id ID of this system
 * @param component_id ID of this component (e.g. 200 for IMU)
 * @param msg The MAVLink message to compress the data into
 *
 * @param sequence  Base tick at whose start it was taken.
 * @param first  Number of the first word here.
 * @param total  Words of the whole frame: params, then state, as in the C.
 * @param words  As they lie in memory; 0 behind the last.
 * @return length of the message in bytes (excluding serial stream start sign)
 */
static inline uint16_t mavlink_msg_esea_key_pack(uint8_t system_id, uint8_t component_id, mavlink_message_t* msg,
                               uint32_t sequence, uint32_t first, uint32_t total, const uint32_t *words)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    char buf[MAVLINK_MSG_ID_ESEA_KEY_LEN];
    _mav_put_uint32_t(buf, 0, sequence);
    _mav_put_uint32_t(buf, 4, first);
    _mav_put_uint32_t(buf, 8, total);
    _mav_put_uint32_t_array(buf, 12, words, 58);
        memcpy(_MAV_PAYLOAD_NON_CONST(msg), buf, MAVLINK_MSG_ID_ESEA_KEY_LEN);
#else
    mavlink_esea_key_t packet;
    packet.sequence = sequence;
    packet.first = first;
    packet.total = total;
    mav_array_memcpy(packet.words, words, sizeof(uint32_t)*58);
        memcpy(_MAV_PAYLOAD_NON_CONST(msg), &packet, MAVLINK_MSG_ID_ESEA_KEY_LEN);
#endif

    msg->msgid = MAVLINK_MSG_ID_ESEA_KEY;
    return mavlink_finalize_message(msg, system_id, component_id, MAVLINK_MSG_ID_ESEA_KEY_MIN_LEN, MAVLINK_MSG_ID_ESEA_KEY_LEN, MAVLINK_MSG_ID_ESEA_KEY_CRC);
}

/**
 * @brief Pack a esea_key message
 * @param system_id ID of this system
 * @param component_id ID of this component (e.g. 200 for IMU)
 * @param status MAVLink status structure
 * @param msg The MAVLink message to compress the data into
 *
 * @param sequence  Base tick at whose start it was taken.
 * @param first  Number of the first word here.
 * @param total  Words of the whole frame: params, then state, as in the C.
 * @param words  As they lie in memory; 0 behind the last.
 * @return length of the message in bytes (excluding serial stream start sign)
 */
static inline uint16_t mavlink_msg_esea_key_pack_status(uint8_t system_id, uint8_t component_id, mavlink_status_t *_status, mavlink_message_t* msg,
                               uint32_t sequence, uint32_t first, uint32_t total, const uint32_t *words)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    char buf[MAVLINK_MSG_ID_ESEA_KEY_LEN];
    _mav_put_uint32_t(buf, 0, sequence);
    _mav_put_uint32_t(buf, 4, first);
    _mav_put_uint32_t(buf, 8, total);
    _mav_put_uint32_t_array(buf, 12, words, 58);
        memcpy(_MAV_PAYLOAD_NON_CONST(msg), buf, MAVLINK_MSG_ID_ESEA_KEY_LEN);
#else
    mavlink_esea_key_t packet;
    packet.sequence = sequence;
    packet.first = first;
    packet.total = total;
    mav_array_memcpy(packet.words, words, sizeof(uint32_t)*58);
        memcpy(_MAV_PAYLOAD_NON_CONST(msg), &packet, MAVLINK_MSG_ID_ESEA_KEY_LEN);
#endif

    msg->msgid = MAVLINK_MSG_ID_ESEA_KEY;
#if MAVLINK_CRC_EXTRA
    return mavlink_finalize_message_buffer(msg, system_id, component_id, _status, MAVLINK_MSG_ID_ESEA_KEY_MIN_LEN, MAVLINK_MSG_ID_ESEA_KEY_LEN, MAVLINK_MSG_ID_ESEA_KEY_CRC);
#else
    return mavlink_finalize_message_buffer(msg, system_id, component_id, _status, MAVLINK_MSG_ID_ESEA_KEY_MIN_LEN, MAVLINK_MSG_ID_ESEA_KEY_LEN);
#endif
}

/**
 * @brief Pack a esea_key message on a channel
 * @param system_id ID of this system
 * @param component_id ID of this component (e.g. 200 for IMU)
 * @param chan The MAVLink channel this message will be sent over
 * @param msg The MAVLink message to compress the data into
 * @param sequence  Base tick at whose start it was taken.
 * @param first  Number of the first word here.
 * @param total  Words of the whole frame: params, then state, as in the C.
 * @param words  As they lie in memory; 0 behind the last.
 * @return length of the message in bytes (excluding serial stream start sign)
 */
static inline uint16_t mavlink_msg_esea_key_pack_chan(uint8_t system_id, uint8_t component_id, uint8_t chan,
                               mavlink_message_t* msg,
                                   uint32_t sequence,uint32_t first,uint32_t total,const uint32_t *words)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    char buf[MAVLINK_MSG_ID_ESEA_KEY_LEN];
    _mav_put_uint32_t(buf, 0, sequence);
    _mav_put_uint32_t(buf, 4, first);
    _mav_put_uint32_t(buf, 8, total);
    _mav_put_uint32_t_array(buf, 12, words, 58);
        memcpy(_MAV_PAYLOAD_NON_CONST(msg), buf, MAVLINK_MSG_ID_ESEA_KEY_LEN);
#else
    mavlink_esea_key_t packet;
    packet.sequence = sequence;
    packet.first = first;
    packet.total = total;
    mav_array_memcpy(packet.words, words, sizeof(uint32_t)*58);
        memcpy(_MAV_PAYLOAD_NON_CONST(msg), &packet, MAVLINK_MSG_ID_ESEA_KEY_LEN);
#endif

    msg->msgid = MAVLINK_MSG_ID_ESEA_KEY;
    return mavlink_finalize_message_chan(msg, system_id, component_id, chan, MAVLINK_MSG_ID_ESEA_KEY_MIN_LEN, MAVLINK_MSG_ID_ESEA_KEY_LEN, MAVLINK_MSG_ID_ESEA_KEY_CRC);
}

/**
 * @brief Encode a esea_key struct
 *
 * @param system_id ID of this system
 * @param component_id ID of this component (e.g. 200 for IMU)
 * @param msg The MAVLink message to compress the data into
 * @param esea_key C-struct to read the message contents from
 */
static inline uint16_t mavlink_msg_esea_key_encode(uint8_t system_id, uint8_t component_id, mavlink_message_t* msg, const mavlink_esea_key_t* esea_key)
{
    return mavlink_msg_esea_key_pack(system_id, component_id, msg, esea_key->sequence, esea_key->first, esea_key->total, esea_key->words);
}

/**
 * @brief Encode a esea_key struct on a channel
 *
 * @param system_id ID of this system
 * @param component_id ID of this component (e.g. 200 for IMU)
 * @param chan The MAVLink channel this message will be sent over
 * @param msg The MAVLink message to compress the data into
 * @param esea_key C-struct to read the message contents from
 */
static inline uint16_t mavlink_msg_esea_key_encode_chan(uint8_t system_id, uint8_t component_id, uint8_t chan, mavlink_message_t* msg, const mavlink_esea_key_t* esea_key)
{
    return mavlink_msg_esea_key_pack_chan(system_id, component_id, chan, msg, esea_key->sequence, esea_key->first, esea_key->total, esea_key->words);
}

/**
 * @brief Encode a esea_key struct with provided status structure
 *
 * @param system_id ID of this system
 * @param component_id ID of this component (e.g. 200 for IMU)
 * @param status MAVLink status structure
 * @param msg The MAVLink message to compress the data into
 * @param esea_key C-struct to read the message contents from
 */
static inline uint16_t mavlink_msg_esea_key_encode_status(uint8_t system_id, uint8_t component_id, mavlink_status_t* _status, mavlink_message_t* msg, const mavlink_esea_key_t* esea_key)
{
    return mavlink_msg_esea_key_pack_status(system_id, component_id, _status, msg,  esea_key->sequence, esea_key->first, esea_key->total, esea_key->words);
}

/**
 * @brief Send a esea_key message
 * @param chan MAVLink channel to send the message
 *
 * @param sequence  Base tick at whose start it was taken.
 * @param first  Number of the first word here.
 * @param total  Words of the whole frame: params, then state, as in the C.
 * @param words  As they lie in memory; 0 behind the last.
 */
#ifdef MAVLINK_USE_CONVENIENCE_FUNCTIONS

static inline void mavlink_msg_esea_key_send(mavlink_channel_t chan, uint32_t sequence, uint32_t first, uint32_t total, const uint32_t *words)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    char buf[MAVLINK_MSG_ID_ESEA_KEY_LEN];
    _mav_put_uint32_t(buf, 0, sequence);
    _mav_put_uint32_t(buf, 4, first);
    _mav_put_uint32_t(buf, 8, total);
    _mav_put_uint32_t_array(buf, 12, words, 58);
    _mav_finalize_message_chan_send(chan, MAVLINK_MSG_ID_ESEA_KEY, buf, MAVLINK_MSG_ID_ESEA_KEY_MIN_LEN, MAVLINK_MSG_ID_ESEA_KEY_LEN, MAVLINK_MSG_ID_ESEA_KEY_CRC);
#else
    mavlink_esea_key_t packet;
    packet.sequence = sequence;
    packet.first = first;
    packet.total = total;
    mav_array_memcpy(packet.words, words, sizeof(uint32_t)*58);
    _mav_finalize_message_chan_send(chan, MAVLINK_MSG_ID_ESEA_KEY, (const char *)&packet, MAVLINK_MSG_ID_ESEA_KEY_MIN_LEN, MAVLINK_MSG_ID_ESEA_KEY_LEN, MAVLINK_MSG_ID_ESEA_KEY_CRC);
#endif
}

/**
 * @brief Send a esea_key message
 * @param chan MAVLink channel to send the message
 * @param struct The MAVLink struct to serialize
 */
static inline void mavlink_msg_esea_key_send_struct(mavlink_channel_t chan, const mavlink_esea_key_t* esea_key)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    mavlink_msg_esea_key_send(chan, esea_key->sequence, esea_key->first, esea_key->total, esea_key->words);
#else
    _mav_finalize_message_chan_send(chan, MAVLINK_MSG_ID_ESEA_KEY, (const char *)esea_key, MAVLINK_MSG_ID_ESEA_KEY_MIN_LEN, MAVLINK_MSG_ID_ESEA_KEY_LEN, MAVLINK_MSG_ID_ESEA_KEY_CRC);
#endif
}

#if MAVLINK_MSG_ID_ESEA_KEY_LEN <= MAVLINK_MAX_PAYLOAD_LEN
/*
  This variant of _send() can be used to save stack space by reusing
  memory from the receive buffer.  The caller provides a
  mavlink_message_t which is the size of a full mavlink message. This
  is usually the receive buffer for the channel, and allows a reply to an
  incoming message with minimum stack space usage.
 */
static inline void mavlink_msg_esea_key_send_buf(mavlink_message_t *msgbuf, mavlink_channel_t chan,  uint32_t sequence, uint32_t first, uint32_t total, const uint32_t *words)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    char *buf = (char *)msgbuf;
    _mav_put_uint32_t(buf, 0, sequence);
    _mav_put_uint32_t(buf, 4, first);
    _mav_put_uint32_t(buf, 8, total);
    _mav_put_uint32_t_array(buf, 12, words, 58);
    _mav_finalize_message_chan_send(chan, MAVLINK_MSG_ID_ESEA_KEY, buf, MAVLINK_MSG_ID_ESEA_KEY_MIN_LEN, MAVLINK_MSG_ID_ESEA_KEY_LEN, MAVLINK_MSG_ID_ESEA_KEY_CRC);
#else
    mavlink_esea_key_t *packet = (mavlink_esea_key_t *)msgbuf;
    packet->sequence = sequence;
    packet->first = first;
    packet->total = total;
    mav_array_memcpy(packet->words, words, sizeof(uint32_t)*58);
    _mav_finalize_message_chan_send(chan, MAVLINK_MSG_ID_ESEA_KEY, (const char *)packet, MAVLINK_MSG_ID_ESEA_KEY_MIN_LEN, MAVLINK_MSG_ID_ESEA_KEY_LEN, MAVLINK_MSG_ID_ESEA_KEY_CRC);
#endif
}
#endif

#endif

// MESSAGE ESEA_KEY UNPACKING


/**
 * @brief Get field sequence from esea_key message
 *
 * @return  Base tick at whose start it was taken.
 */
static inline uint32_t mavlink_msg_esea_key_get_sequence(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint32_t(msg,  0);
}

/**
 * @brief Get field first from esea_key message
 *
 * @return  Number of the first word here.
 */
static inline uint32_t mavlink_msg_esea_key_get_first(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint32_t(msg,  4);
}

/**
 * @brief Get field total from esea_key message
 *
 * @return  Words of the whole frame: params, then state, as in the C.
 */
static inline uint32_t mavlink_msg_esea_key_get_total(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint32_t(msg,  8);
}

/**
 * @brief Get field words from esea_key message
 *
 * @return  As they lie in memory; 0 behind the last.
 */
static inline uint16_t mavlink_msg_esea_key_get_words(const mavlink_message_t* msg, uint32_t *words)
{
    return _MAV_RETURN_uint32_t_array(msg, words, 58,  12);
}

/**
 * @brief Decode a esea_key message into a struct
 *
 * @param msg The message to decode
 * @param esea_key C-struct to decode the message contents into
 */
static inline void mavlink_msg_esea_key_decode(const mavlink_message_t* msg, mavlink_esea_key_t* esea_key)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    esea_key->sequence = mavlink_msg_esea_key_get_sequence(msg);
    esea_key->first = mavlink_msg_esea_key_get_first(msg);
    esea_key->total = mavlink_msg_esea_key_get_total(msg);
    mavlink_msg_esea_key_get_words(msg, esea_key->words);
#else
        uint8_t len = msg->len < MAVLINK_MSG_ID_ESEA_KEY_LEN? msg->len : MAVLINK_MSG_ID_ESEA_KEY_LEN;
        memset(esea_key, 0, MAVLINK_MSG_ID_ESEA_KEY_LEN);
    memcpy(esea_key, _MAV_PAYLOAD(msg), len);
#endif
}
