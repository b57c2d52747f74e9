#pragma once
// MESSAGE ESEA_KEPT PACKING

#include <stdint.h>

#define MAVLINK_MSG_ID_ESEA_KEPT 42666


typedef struct __mavlink_esea_kept_t {
 uint32_t serial[4]; /*<  Serial numbers of the encoders that are fitted; 0: none.*/
 float zero_rad[4]; /*<  Their zeros as they are kept, NaN: none.*/
 uint32_t starts; /*<  Power-ups.*/
 uint32_t armings; /*<  Times that the motor was switched on.*/
 uint32_t faults; /*<  Faults that were latched.*/
 uint32_t watchdog_resets; /*<  Resets by the watchdog.*/
 uint32_t saves; /*<  Sets written to the memory.*/
 uint32_t active_s; /*< [s] Time with the motor on.*/
 uint8_t encoders; /*<  How many of these the device has.*/
 uint8_t zero; /*<  Where the zero in force comes from.*/
 uint8_t result; /*<  Of naming the encoders.*/
} mavlink_esea_kept_t;

#define MAVLINK_MSG_ID_ESEA_KEPT_LEN 59
#define MAVLINK_MSG_ID_ESEA_KEPT_MIN_LEN 59
#define MAVLINK_MSG_ID_42666_LEN 59
#define MAVLINK_MSG_ID_42666_MIN_LEN 59

#define MAVLINK_MSG_ID_ESEA_KEPT_CRC 84
#define MAVLINK_MSG_ID_42666_CRC 84

#define MAVLINK_MSG_ESEA_KEPT_FIELD_SERIAL_LEN 4
#define MAVLINK_MSG_ESEA_KEPT_FIELD_ZERO_RAD_LEN 4

#if MAVLINK_COMMAND_24BIT
#define MAVLINK_MESSAGE_INFO_ESEA_KEPT { \
    42666, \
    "ESEA_KEPT", \
    11, \
    {  { "serial", NULL, MAVLINK_TYPE_UINT32_T, 4, 0, offsetof(mavlink_esea_kept_t, serial) }, \
         { "zero_rad", NULL, MAVLINK_TYPE_FLOAT, 4, 16, offsetof(mavlink_esea_kept_t, zero_rad) }, \
         { "starts", NULL, MAVLINK_TYPE_UINT32_T, 0, 32, offsetof(mavlink_esea_kept_t, starts) }, \
         { "armings", NULL, MAVLINK_TYPE_UINT32_T, 0, 36, offsetof(mavlink_esea_kept_t, armings) }, \
         { "faults", NULL, MAVLINK_TYPE_UINT32_T, 0, 40, offsetof(mavlink_esea_kept_t, faults) }, \
         { "watchdog_resets", NULL, MAVLINK_TYPE_UINT32_T, 0, 44, offsetof(mavlink_esea_kept_t, watchdog_resets) }, \
         { "saves", NULL, MAVLINK_TYPE_UINT32_T, 0, 48, offsetof(mavlink_esea_kept_t, saves) }, \
         { "active_s", NULL, MAVLINK_TYPE_UINT32_T, 0, 52, offsetof(mavlink_esea_kept_t, active_s) }, \
         { "encoders", NULL, MAVLINK_TYPE_UINT8_T, 0, 56, offsetof(mavlink_esea_kept_t, encoders) }, \
         { "zero", NULL, MAVLINK_TYPE_UINT8_T, 0, 57, offsetof(mavlink_esea_kept_t, zero) }, \
         { "result", NULL, MAVLINK_TYPE_UINT8_T, 0, 58, offsetof(mavlink_esea_kept_t, result) }, \
         } \
}
#else
#define MAVLINK_MESSAGE_INFO_ESEA_KEPT { \
    "ESEA_KEPT", \
    11, \
    {  { "serial", NULL, MAVLINK_TYPE_UINT32_T, 4, 0, offsetof(mavlink_esea_kept_t, serial) }, \
         { "zero_rad", NULL, MAVLINK_TYPE_FLOAT, 4, 16, offsetof(mavlink_esea_kept_t, zero_rad) }, \
         { "starts", NULL, MAVLINK_TYPE_UINT32_T, 0, 32, offsetof(mavlink_esea_kept_t, starts) }, \
         { "armings", NULL, MAVLINK_TYPE_UINT32_T, 0, 36, offsetof(mavlink_esea_kept_t, armings) }, \
         { "faults", NULL, MAVLINK_TYPE_UINT32_T, 0, 40, offsetof(mavlink_esea_kept_t, faults) }, \
         { "watchdog_resets", NULL, MAVLINK_TYPE_UINT32_T, 0, 44, offsetof(mavlink_esea_kept_t, watchdog_resets) }, \
         { "saves", NULL, MAVLINK_TYPE_UINT32_T, 0, 48, offsetof(mavlink_esea_kept_t, saves) }, \
         { "active_s", NULL, MAVLINK_TYPE_UINT32_T, 0, 52, offsetof(mavlink_esea_kept_t, active_s) }, \
         { "encoders", NULL, MAVLINK_TYPE_UINT8_T, 0, 56, offsetof(mavlink_esea_kept_t, encoders) }, \
         { "zero", NULL, MAVLINK_TYPE_UINT8_T, 0, 57, offsetof(mavlink_esea_kept_t, zero) }, \
         { "result", NULL, MAVLINK_TYPE_UINT8_T, 0, 58, offsetof(mavlink_esea_kept_t, result) }, \
         } \
}
#endif

/**
 * @brief Pack a esea_kept message
 * @param system_id ID of this system
 * @param component_id ID of this component (e.g. 200 for IMU)
 * @param msg The MAVLink message to compress the data into
 *
 * @param serial  Serial numbers of the encoders that are fitted; 0: none.
 * @param zero_rad  Their zeros as they are kept, NaN: none.
 * @param starts  Power-ups.
 * @param armings  Times that the motor was switched on.
 * @param faults  Faults that were latched.
 * @param watchdog_resets  Resets by the watchdog.
 * @param saves  Sets written to the memory.
 * @param active_s [s] Time with the motor on.
 * @param encoders  How many of these the device has.
 * @param zero  Where the zero in force comes from.
 * @param result  Of naming the encoders.
 * @return length of the message in bytes (excluding serial stream start sign)
 */
static inline uint16_t mavlink_msg_esea_kept_pack(uint8_t system_id, uint8_t component_id, mavlink_message_t* msg,
                               const uint32_t *serial, const float *zero_rad, uint32_t starts, uint32_t armings, uint32_t faults, uint32_t watchdog_resets, uint32_t saves, uint32_t active_s, uint8_t encoders, uint8_t zero, uint8_t result)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    char buf[MAVLINK_MSG_ID_ESEA_KEPT_LEN];
    _mav_put_uint32_t(buf, 32, starts);
    _mav_put_uint32_t(buf, 36, armings);
    _mav_put_uint32_t(buf, 40, faults);
    _mav_put_uint32_t(buf, 44, watchdog_resets);
    _mav_put_uint32_t(buf, 48, saves);
    _mav_put_uint32_t(buf, 52, active_s);
    _mav_put_uint8_t(buf, 56, encoders);
    _mav_put_uint8_t(buf, 57, zero);
    _mav_put_uint8_t(buf, 58, result);
    _mav_put_uint32_t_array(buf, 0, serial, 4);
    _mav_put_float_array(buf, 16, zero_rad, 4);
        memcpy(_MAV_PAYLOAD_NON_CONST(msg), buf, MAVLINK_MSG_ID_ESEA_KEPT_LEN);
#else
    mavlink_esea_kept_t packet;
    packet.starts = starts;
    packet.armings = armings;
    packet.faults = faults;
    packet.watchdog_resets = watchdog_resets;
    packet.saves = saves;
    packet.active_s = active_s;
    packet.encoders = encoders;
    packet.zero = zero;
    packet.result = result;
    mav_array_memcpy(packet.serial, serial, sizeof(uint32_t)*4);
    mav_array_memcpy(packet.zero_rad, zero_rad, sizeof(float)*4);
        memcpy(_MAV_PAYLOAD_NON_CONST(msg), &packet, MAVLINK_MSG_ID_ESEA_KEPT_LEN);
#endif

    msg->msgid = MAVLINK_MSG_ID_ESEA_KEPT;
    return mavlink_finalize_message(msg, system_id, component_id, MAVLINK_MSG_ID_ESEA_KEPT_MIN_LEN, MAVLINK_MSG_ID_ESEA_KEPT_LEN, MAVLINK_MSG_ID_ESEA_KEPT_CRC);
}

/**
 * @brief Pack a esea_kept message
 * @param system_id ID of this system
 * @param component_id ID of this component (e.g. 200 for IMU)
 * @param status MAVLink status structure
 * @param msg The MAVLink message to compress the data into
 *
 * @param serial  Serial numbers of the encoders that are fitted; 0: none.
 * @param zero_rad  Their zeros as they are kept, NaN: none.
 * @param starts  Power-ups.
 * @param armings  Times that the motor was switched on.
 * @param faults  Faults that were latched.
 * @param watchdog_resets  Resets by the watchdog.
 * @param saves  Sets written to the memory.
 * @param active_s [s] Time with the motor on.
 * @param encoders  How many of these the device has.
 * @param zero  Where the zero in force comes from.
 * @param result  Of naming the encoders.
 * @return length of the message in bytes (excluding serial stream start sign)
 */
static inline uint16_t mavlink_msg_esea_kept_pack_status(uint8_t system_id, uint8_t component_id, mavlink_status_t *_status, mavlink_message_t* msg,
                               const uint32_t *serial, const float *zero_rad, uint32_t starts, uint32_t armings, uint32_t faults, uint32_t watchdog_resets, uint32_t saves, uint32_t active_s, uint8_t encoders, uint8_t zero, uint8_t result)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    char buf[MAVLINK_MSG_ID_ESEA_KEPT_LEN];
    _mav_put_uint32_t(buf, 32, starts);
    _mav_put_uint32_t(buf, 36, armings);
    _mav_put_uint32_t(buf, 40, faults);
    _mav_put_uint32_t(buf, 44, watchdog_resets);
    _mav_put_uint32_t(buf, 48, saves);
    _mav_put_uint32_t(buf, 52, active_s);
    _mav_put_uint8_t(buf, 56, encoders);
    _mav_put_uint8_t(buf, 57, zero);
    _mav_put_uint8_t(buf, 58, result);
    _mav_put_uint32_t_array(buf, 0, serial, 4);
    _mav_put_float_array(buf, 16, zero_rad, 4);
        memcpy(_MAV_PAYLOAD_NON_CONST(msg), buf, MAVLINK_MSG_ID_ESEA_KEPT_LEN);
#else
    mavlink_esea_kept_t packet;
    packet.starts = starts;
    packet.armings = armings;
    packet.faults = faults;
    packet.watchdog_resets = watchdog_resets;
    packet.saves = saves;
    packet.active_s = active_s;
    packet.encoders = encoders;
    packet.zero = zero;
    packet.result = result;
    mav_array_memcpy(packet.serial, serial, sizeof(uint32_t)*4);
    mav_array_memcpy(packet.zero_rad, zero_rad, sizeof(float)*4);
        memcpy(_MAV_PAYLOAD_NON_CONST(msg), &packet, MAVLINK_MSG_ID_ESEA_KEPT_LEN);
#endif

    msg->msgid = MAVLINK_MSG_ID_ESEA_KEPT;
#if MAVLINK_CRC_EXTRA
    return mavlink_finalize_message_buffer(msg, system_id, component_id, _status, MAVLINK_MSG_ID_ESEA_KEPT_MIN_LEN, MAVLINK_MSG_ID_ESEA_KEPT_LEN, MAVLINK_MSG_ID_ESEA_KEPT_CRC);
#else
    return mavlink_finalize_message_buffer(msg, system_id, component_id, _status, MAVLINK_MSG_ID_ESEA_KEPT_MIN_LEN, MAVLINK_MSG_ID_ESEA_KEPT_LEN);
#endif
}

/**
 * @brief Pack a esea_kept message on a channel
 * @param system_id ID of this system
 * @param component_id ID of this component (e.g. 200 for IMU)
 * @param chan The MAVLink channel this message will be sent over
 * @param msg The MAVLink message to compress the data into
 * @param serial  Serial numbers of the encoders that are fitted; 0: none.
 * @param zero_rad  Their zeros as they are kept, NaN: none.
 * @param starts  Power-ups.
 * @param armings  Times that the motor was switched on.
 * @param faults  Faults that were latched.
 * @param watchdog_resets  Resets by the watchdog.
 * @param saves  Sets written to the memory.
 * @param active_s [s] Time with the motor on.
 * @param encoders  How many of these the device has.
 * @param zero  Where the zero in force comes from.
 * @param result  Of naming the encoders.
 * @return length of the message in bytes (excluding serial stream start sign)
 */
static inline uint16_t mavlink_msg_esea_kept_pack_chan(uint8_t system_id, uint8_t component_id, uint8_t chan,
                               mavlink_message_t* msg,
                                   const uint32_t *serial,const float *zero_rad,uint32_t starts,uint32_t armings,uint32_t faults,uint32_t watchdog_resets,uint32_t saves,uint32_t active_s,uint8_t encoders,uint8_t zero,uint8_t result)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    char buf[MAVLINK_MSG_ID_ESEA_KEPT_LEN];
    _mav_put_uint32_t(buf, 32, starts);
    _mav_put_uint32_t(buf, 36, armings);
    _mav_put_uint32_t(buf, 40, faults);
    _mav_put_uint32_t(buf, 44, watchdog_resets);
    _mav_put_uint32_t(buf, 48, saves);
    _mav_put_uint32_t(buf, 52, active_s);
    _mav_put_uint8_t(buf, 56, encoders);
    _mav_put_uint8_t(buf, 57, zero);
    _mav_put_uint8_t(buf, 58, result);
    _mav_put_uint32_t_array(buf, 0, serial, 4);
    _mav_put_float_array(buf, 16, zero_rad, 4);
        memcpy(_MAV_PAYLOAD_NON_CONST(msg), buf, MAVLINK_MSG_ID_ESEA_KEPT_LEN);
#else
    mavlink_esea_kept_t packet;
    packet.starts = starts;
    packet.armings = armings;
    packet.faults = faults;
    packet.watchdog_resets = watchdog_resets;
    packet.saves = saves;
    packet.active_s = active_s;
    packet.encoders = encoders;
    packet.zero = zero;
    packet.result = result;
    mav_array_memcpy(packet.serial, serial, sizeof(uint32_t)*4);
    mav_array_memcpy(packet.zero_rad, zero_rad, sizeof(float)*4);
        memcpy(_MAV_PAYLOAD_NON_CONST(msg), &packet, MAVLINK_MSG_ID_ESEA_KEPT_LEN);
#endif

    msg->msgid = MAVLINK_MSG_ID_ESEA_KEPT;
    return mavlink_finalize_message_chan(msg, system_id, component_id, chan, MAVLINK_MSG_ID_ESEA_KEPT_MIN_LEN, MAVLINK_MSG_ID_ESEA_KEPT_LEN, MAVLINK_MSG_ID_ESEA_KEPT_CRC);
}

/**
 * @brief Encode a esea_kept struct
 *
 * @param system_id ID of this system
 * @param component_id ID of this component (e.g. 200 for IMU)
 * @param msg The MAVLink message to compress the data into
 * @param esea_kept C-struct to read the message contents from
 */
static inline uint16_t mavlink_msg_esea_kept_encode(uint8_t system_id, uint8_t component_id, mavlink_message_t* msg, const mavlink_esea_kept_t* esea_kept)
{
    return mavlink_msg_esea_kept_pack(system_id, component_id, msg, esea_kept->serial, esea_kept->zero_rad, esea_kept->starts, esea_kept->armings, esea_kept->faults, esea_kept->watchdog_resets, esea_kept->saves, esea_kept->active_s, esea_kept->encoders, esea_kept->zero, esea_kept->result);
}

/**
 * @brief Encode a esea_kept struct on a channel
 *
 * @param system_id ID of this system
 * @param component_id ID of this component (e.g. 200 for IMU)
 * @param chan The MAVLink channel this message will be sent over
 * @param msg The MAVLink message to compress the data into
 * @param esea_kept C-struct to read the message contents from
 */
static inline uint16_t mavlink_msg_esea_kept_encode_chan(uint8_t system_id, uint8_t component_id, uint8_t chan, mavlink_message_t* msg, const mavlink_esea_kept_t* esea_kept)
{
    return mavlink_msg_esea_kept_pack_chan(system_id, component_id, chan, msg, esea_kept->serial, esea_kept->zero_rad, esea_kept->starts, esea_kept->armings, esea_kept->faults, esea_kept->watchdog_resets, esea_kept->saves, esea_kept->active_s, esea_kept->encoders, esea_kept->zero, esea_kept->result);
}

/**
 * @brief Encode a esea_kept struct with provided status structure
 *
 * @param system_id ID of this system
 * @param component_id ID of this component (e.g. 200 for IMU)
 * @param status MAVLink status structure
 * @param msg The MAVLink message to compress the data into
 * @param esea_kept C-struct to read the message contents from
 */
static inline uint16_t mavlink_msg_esea_kept_encode_status(uint8_t system_id, uint8_t component_id, mavlink_status_t* _status, mavlink_message_t* msg, const mavlink_esea_kept_t* esea_kept)
{
    return mavlink_msg_esea_kept_pack_status(system_id, component_id, _status, msg,  esea_kept->serial, esea_kept->zero_rad, esea_kept->starts, esea_kept->armings, esea_kept->faults, esea_kept->watchdog_resets, esea_kept->saves, esea_kept->active_s, esea_kept->encoders, esea_kept->zero, esea_kept->result);
}

/**
 * @brief Send a esea_kept message
 * @param chan MAVLink channel to send the message
 *
 * @param serial  Serial numbers of the encoders that are fitted; 0: none.
 * @param zero_rad  Their zeros as they are kept, NaN: none.
 * @param starts  Power-ups.
 * @param armings  Times that the motor was switched on.
 * @param faults  Faults that were latched.
 * @param watchdog_resets  Resets by the watchdog.
 * @param saves  Sets written to the memory.
 * @param active_s [s] Time with the motor on.
 * @param encoders  How many of these the device has.
 * @param zero  Where the zero in force comes from.
 * @param result  Of naming the encoders.
 */
#ifdef MAVLINK_USE_CONVENIENCE_FUNCTIONS

static inline void mavlink_msg_esea_kept_send(mavlink_channel_t chan, const uint32_t *serial, const float *zero_rad, uint32_t starts, uint32_t armings, uint32_t faults, uint32_t watchdog_resets, uint32_t saves, uint32_t active_s, uint8_t encoders, uint8_t zero, uint8_t result)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    char buf[MAVLINK_MSG_ID_ESEA_KEPT_LEN];
    _mav_put_uint32_t(buf, 32, starts);
    _mav_put_uint32_t(buf, 36, armings);
    _mav_put_uint32_t(buf, 40, faults);
    _mav_put_uint32_t(buf, 44, watchdog_resets);
    _mav_put_uint32_t(buf, 48, saves);
    _mav_put_uint32_t(buf, 52, active_s);
    _mav_put_uint8_t(buf, 56, encoders);
    _mav_put_uint8_t(buf, 57, zero);
    _mav_put_uint8_t(buf, 58, result);
    _mav_put_uint32_t_array(buf, 0, serial, 4);
    _mav_put_float_array(buf, 16, zero_rad, 4);
    _mav_finalize_message_chan_send(chan, MAVLINK_MSG_ID_ESEA_KEPT, buf, MAVLINK_MSG_ID_ESEA_KEPT_MIN_LEN, MAVLINK_MSG_ID_ESEA_KEPT_LEN, MAVLINK_MSG_ID_ESEA_KEPT_CRC);
#else
    mavlink_esea_kept_t packet;
    packet.starts = starts;
    packet.armings = armings;
    packet.faults = faults;
    packet.watchdog_resets = watchdog_resets;
    packet.saves = saves;
    packet.active_s = active_s;
    packet.encoders = encoders;
    packet.zero = zero;
    packet.result = result;
    mav_array_memcpy(packet.serial, serial, sizeof(uint32_t)*4);
    mav_array_memcpy(packet.zero_rad, zero_rad, sizeof(float)*4);
    _mav_finalize_message_chan_send(chan, MAVLINK_MSG_ID_ESEA_KEPT, (const char *)&packet, MAVLINK_MSG_ID_ESEA_KEPT_MIN_LEN, MAVLINK_MSG_ID_ESEA_KEPT_LEN, MAVLINK_MSG_ID_ESEA_KEPT_CRC);
#endif
}

/**
 * @brief Send a esea_kept message
 * @param chan MAVLink channel to send the message
 * @param struct The MAVLink struct to serialize
 */
static inline void mavlink_msg_esea_kept_send_struct(mavlink_channel_t chan, const mavlink_esea_kept_t* esea_kept)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    mavlink_msg_esea_kept_send(chan, esea_kept->serial, esea_kept->zero_rad, esea_kept->starts, esea_kept->armings, esea_kept->faults, esea_kept->watchdog_resets, esea_kept->saves, esea_kept->active_s, esea_kept->encoders, esea_kept->zero, esea_kept->result);
#else
    _mav_finalize_message_chan_send(chan, MAVLINK_MSG_ID_ESEA_KEPT, (const char *)esea_kept, MAVLINK_MSG_ID_ESEA_KEPT_MIN_LEN, MAVLINK_MSG_ID_ESEA_KEPT_LEN, MAVLINK_MSG_ID_ESEA_KEPT_CRC);
#endif
}

#if MAVLINK_MSG_ID_ESEA_KEPT_LEN <= MAVLINK_MAX_PAYLOAD_LEN
/*
  This variant of _send() can be used to save stack space by reusing
  memory from the receive buffer.  The caller provides a
  mavlink_message_t which is the size of a full mavlink message. This
  is usually the receive buffer for the channel, and allows a reply to an
  incoming message with minimum stack space usage.
 */
static inline void mavlink_msg_esea_kept_send_buf(mavlink_message_t *msgbuf, mavlink_channel_t chan,  const uint32_t *serial, const float *zero_rad, uint32_t starts, uint32_t armings, uint32_t faults, uint32_t watchdog_resets, uint32_t saves, uint32_t active_s, uint8_t encoders, uint8_t zero, uint8_t result)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    char *buf = (char *)msgbuf;
    _mav_put_uint32_t(buf, 32, starts);
    _mav_put_uint32_t(buf, 36, armings);
    _mav_put_uint32_t(buf, 40, faults);
    _mav_put_uint32_t(buf, 44, watchdog_resets);
    _mav_put_uint32_t(buf, 48, saves);
    _mav_put_uint32_t(buf, 52, active_s);
    _mav_put_uint8_t(buf, 56, encoders);
    _mav_put_uint8_t(buf, 57, zero);
    _mav_put_uint8_t(buf, 58, result);
    _mav_put_uint32_t_array(buf, 0, serial, 4);
    _mav_put_float_array(buf, 16, zero_rad, 4);
    _mav_finalize_message_chan_send(chan, MAVLINK_MSG_ID_ESEA_KEPT, buf, MAVLINK_MSG_ID_ESEA_KEPT_MIN_LEN, MAVLINK_MSG_ID_ESEA_KEPT_LEN, MAVLINK_MSG_ID_ESEA_KEPT_CRC);
#else
    mavlink_esea_kept_t *packet = (mavlink_esea_kept_t *)msgbuf;
    packet->starts = starts;
    packet->armings = armings;
    packet->faults = faults;
    packet->watchdog_resets = watchdog_resets;
    packet->saves = saves;
    packet->active_s = active_s;
    packet->encoders = encoders;
    packet->zero = zero;
    packet->result = result;
    mav_array_memcpy(packet->serial, serial, sizeof(uint32_t)*4);
    mav_array_memcpy(packet->zero_rad, zero_rad, sizeof(float)*4);
    _mav_finalize_message_chan_send(chan, MAVLINK_MSG_ID_ESEA_KEPT, (const char *)packet, MAVLINK_MSG_ID_ESEA_KEPT_MIN_LEN, MAVLINK_MSG_ID_ESEA_KEPT_LEN, MAVLINK_MSG_ID_ESEA_KEPT_CRC);
#endif
}
#endif

#endif

// MESSAGE ESEA_KEPT UNPACKING


/**
 * @brief Get field serial from esea_kept message
 *
 * @return  Serial numbers of the encoders that are fitted; 0: none.
 */
static inline uint16_t mavlink_msg_esea_kept_get_serial(const mavlink_message_t* msg, uint32_t *serial)
{
    return _MAV_RETURN_uint32_t_array(msg, serial, 4,  0);
}

/**
 * @brief Get field zero_rad from esea_kept message
 *
 * @return  Their zeros as they are kept, NaN: none.
 */
static inline uint16_t mavlink_msg_esea_kept_get_zero_rad(const mavlink_message_t* msg, float *zero_rad)
{
    return _MAV_RETURN_float_array(msg, zero_rad, 4,  16);
}

/**
 * @brief Get field starts from esea_kept message
 *
 * @return  Power-ups.
 */
static inline uint32_t mavlink_msg_esea_kept_get_starts(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint32_t(msg,  32);
}

/**
 * @brief Get field armings from esea_kept message
 *
 * @return  Times that the motor was switched on.
 */
static inline uint32_t mavlink_msg_esea_kept_get_armings(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint32_t(msg,  36);
}

/**
 * @brief Get field faults from esea_kept message
 *
 * @return  Faults that were latched.
 */
static inline uint32_t mavlink_msg_esea_kept_get_faults(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint32_t(msg,  40);
}

/**
 * @brief Get field watchdog_resets from esea_kept message
 *
 * @return  Resets by the watchdog.
 */
static inline uint32_t mavlink_msg_esea_kept_get_watchdog_resets(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint32_t(msg,  44);
}

/**
 * @brief Get field saves from esea_kept message
 *
 * @return  Sets written to the memory.
 */
static inline uint32_t mavlink_msg_esea_kept_get_saves(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint32_t(msg,  48);
}

/**
 * @brief Get field active_s from esea_kept message
 *
 * @return [s] Time with the motor on.
 */
static inline uint32_t mavlink_msg_esea_kept_get_active_s(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint32_t(msg,  52);
}

/**
 * @brief Get field encoders from esea_kept message
 *
 * @return  How many of these the device has.
 */
static inline uint8_t mavlink_msg_esea_kept_get_encoders(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint8_t(msg,  56);
}

/**
 * @brief Get field zero from esea_kept message
 *
 * @return  Where the zero in force comes from.
 */
static inline uint8_t mavlink_msg_esea_kept_get_zero(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint8_t(msg,  57);
}

/**
 * @brief Get field result from esea_kept message
 *
 * @return  Of naming the encoders.
 */
static inline uint8_t mavlink_msg_esea_kept_get_result(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint8_t(msg,  58);
}

/**
 * @brief Decode a esea_kept message into a struct
 *
 * @param msg The message to decode
 * @param esea_kept C-struct to decode the message contents into
 */
static inline void mavlink_msg_esea_kept_decode(const mavlink_message_t* msg, mavlink_esea_kept_t* esea_kept)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    mavlink_msg_esea_kept_get_serial(msg, esea_kept->serial);
    mavlink_msg_esea_kept_get_zero_rad(msg, esea_kept->zero_rad);
    esea_kept->starts = mavlink_msg_esea_kept_get_starts(msg);
    esea_kept->armings = mavlink_msg_esea_kept_get_armings(msg);
    esea_kept->faults = mavlink_msg_esea_kept_get_faults(msg);
    esea_kept->watchdog_resets = mavlink_msg_esea_kept_get_watchdog_resets(msg);
    esea_kept->saves = mavlink_msg_esea_kept_get_saves(msg);
    esea_kept->active_s = mavlink_msg_esea_kept_get_active_s(msg);
    esea_kept->encoders = mavlink_msg_esea_kept_get_encoders(msg);
    esea_kept->zero = mavlink_msg_esea_kept_get_zero(msg);
    esea_kept->result = mavlink_msg_esea_kept_get_result(msg);
#else
        uint8_t len = msg->len < MAVLINK_MSG_ID_ESEA_KEPT_LEN? msg->len : MAVLINK_MSG_ID_ESEA_KEPT_LEN;
        memset(esea_kept, 0, MAVLINK_MSG_ID_ESEA_KEPT_LEN);
    memcpy(esea_kept, _MAV_PAYLOAD(msg), len);
#endif
}
