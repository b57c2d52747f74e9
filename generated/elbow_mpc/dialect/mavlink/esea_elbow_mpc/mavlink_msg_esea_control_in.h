#pragma once
// MESSAGE ESEA_CONTROL_IN PACKING

#include <stdint.h>

#define MAVLINK_MSG_ID_ESEA_CONTROL_IN 42603


typedef struct __mavlink_esea_control_in_t {
 uint32_t sequence; /*<  Base tick of this run of the task.*/
 float tau_preview_Nm[10]; /*<  wanted torque at the intervals' ends; 10 elements; [Nm], range -20 to 20*/
 float theta_preview_rad[10]; /*< [rad] wanted angle; 10 elements; [rad], range -0.949999988 to 3.3499999*/
 float omega_preview_rad_s[10]; /*< [rad/s] wanted rate; 10 elements; [rad/s], range -12 to 12*/
} mavlink_esea_control_in_t;

#define MAVLINK_MSG_ID_ESEA_CONTROL_IN_LEN 124
#define MAVLINK_MSG_ID_ESEA_CONTROL_IN_MIN_LEN 124
#define MAVLINK_MSG_ID_42603_LEN 124
#define MAVLINK_MSG_ID_42603_MIN_LEN 124

#define MAVLINK_MSG_ID_ESEA_CONTROL_IN_CRC 75
#define MAVLINK_MSG_ID_42603_CRC 75

#define MAVLINK_MSG_ESEA_CONTROL_IN_FIELD_TAU_PREVIEW_NM_LEN 10
#define MAVLINK_MSG_ESEA_CONTROL_IN_FIELD_THETA_PREVIEW_RAD_LEN 10
#define MAVLINK_MSG_ESEA_CONTROL_IN_FIELD_OMEGA_PREVIEW_RAD_S_LEN 10

#if MAVLINK_COMMAND_24BIT
#define MAVLINK_MESSAGE_INFO_ESEA_CONTROL_IN { \
    42603, \
    "ESEA_CONTROL_IN", \
    4, \
    {  { "sequence", NULL, MAVLINK_TYPE_UINT32_T, 0, 0, offsetof(mavlink_esea_control_in_t, sequence) }, \
         { "tau_preview_Nm", NULL, MAVLINK_TYPE_FLOAT, 10, 4, offsetof(mavlink_esea_control_in_t, tau_preview_Nm) }, \
         { "theta_preview_rad", NULL, MAVLINK_TYPE_FLOAT, 10, 44, offsetof(mavlink_esea_control_in_t, theta_preview_rad) }, \
         { "omega_preview_rad_s", NULL, MAVLINK_TYPE_FLOAT, 10, 84, offsetof(mavlink_esea_control_in_t, omega_preview_rad_s) }, \
         } \
}
#else
#define MAVLINK_MESSAGE_INFO_ESEA_CONTROL_IN { \
    "ESEA_CONTROL_IN", \
    4, \
    {  { "sequence", NULL, MAVLINK_TYPE_UINT32_T, 0, 0, offsetof(mavlink_esea_control_in_t, sequence) }, \
         { "tau_preview_Nm", NULL, MAVLINK_TYPE_FLOAT, 10, 4, offsetof(mavlink_esea_control_in_t, tau_preview_Nm) }, \
         { "theta_preview_rad", NULL, MAVLINK_TYPE_FLOAT, 10, 44, offsetof(mavlink_esea_control_in_t, theta_preview_rad) }, \
         { "omega_preview_rad_s", NULL, MAVLINK_TYPE_FLOAT, 10, 84, offsetof(mavlink_esea_control_in_t, omega_preview_rad_s) }, \
         } \
}
#endif

/**
 * @brief Pack a esea_control_in message
 * @param system_id ID of this system
 * @param component_id ID of this component (e.g. 200 for IMU)
 * @param msg The MAVLink message to compress the data into
 *
 * @param sequence  Base tick of this run of the task.
 * @param tau_preview_Nm  wanted torque at the intervals' ends; 10 elements; [Nm], range -20 to 20
 * @param theta_preview_rad [rad] wanted angle; 10 elements; [rad], range -0.949999988 to 3.3499999
 * @param omega_preview_rad_s [rad/s] wanted rate; 10 elements; [rad/s], range -12 to 12
 * @return length of the message in bytes (excluding serial stream start sign)
 */
static inline uint16_t mavlink_msg_esea_control_in_pack(uint8_t system_id, uint8_t component_id, mavlink_message_t* msg,
                               uint32_t sequence, const float *tau_preview_Nm, const float *theta_preview_rad, const float *omega_preview_rad_s)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    char buf[MAVLINK_MSG_ID_ESEA_CONTROL_IN_LEN];
    _mav_put_uint32_t(buf, 0, sequence);
    _mav_put_float_array(buf, 4, tau_preview_Nm, 10);
    _mav_put_float_array(buf, 44, theta_preview_rad, 10);
    _mav_put_float_array(buf, 84, omega_preview_rad_s, 10);
        memcpy(_MAV_PAYLOAD_NON_CONST(msg), buf, MAVLINK_MSG_ID_ESEA_CONTROL_IN_LEN);
#else
    mavlink_esea_control_in_t packet;
    packet.sequence = sequence;
    mav_array_memcpy(packet.tau_preview_Nm, tau_preview_Nm, sizeof(float)*10);
    mav_array_memcpy(packet.theta_preview_rad, theta_preview_rad, sizeof(float)*10);
    mav_array_memcpy(packet.omega_preview_rad_s, omega_preview_rad_s, sizeof(float)*10);
        memcpy(_MAV_PAYLOAD_NON_CONST(msg), &packet, MAVLINK_MSG_ID_ESEA_CONTROL_IN_LEN);
#endif

    msg->msgid = MAVLINK_MSG_ID_ESEA_CONTROL_IN;
    return mavlink_finalize_message(msg, system_id, component_id, MAVLINK_MSG_ID_ESEA_CONTROL_IN_MIN_LEN, MAVLINK_MSG_ID_ESEA_CONTROL_IN_LEN, MAVLINK_MSG_ID_ESEA_CONTROL_IN_CRC);
}

/**
 * @brief Pack a esea_control_in message
 * @param system_id ID of this system
 * @param component_id ID of this component (e.g. 200 for IMU)
 * @param status MAVLink status structure
 * @param msg The MAVLink message to compress the data into
 *
 * @param sequence  Base tick of this run of the task.
 * @param tau_preview_Nm  wanted torque at the intervals' ends; 10 elements; [Nm], range -20 to 20
 * @param theta_preview_rad [rad] wanted angle; 10 elements; [rad], range -0.949999988 to 3.3499999
 * @param omega_preview_rad_s [rad/s] wanted rate; 10 elements; [rad/s], range -12 to 12
 * @return length of the message in bytes (excluding serial stream start sign)
 */
static inline uint16_t mavlink_msg_esea_control_in_pack_status(uint8_t system_id, uint8_t component_id, mavlink_status_t *_status, mavlink_message_t* msg,
                               uint32_t sequence, const float *tau_preview_Nm, const float *theta_preview_rad, const float *omega_preview_rad_s)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    char buf[MAVLINK_MSG_ID_ESEA_CONTROL_IN_LEN];
    _mav_put_uint32_t(buf, 0, sequence);
    _mav_put_float_array(buf, 4, tau_preview_Nm, 10);
    _mav_put_float_array(buf, 44, theta_preview_rad, 10);
    _mav_put_float_array(buf, 84, omega_preview_rad_s, 10);
        memcpy(_MAV_PAYLOAD_NON_CONST(msg), buf, MAVLINK_MSG_ID_ESEA_CONTROL_IN_LEN);
#else
    mavlink_esea_control_in_t packet;
    packet.sequence = sequence;
    mav_array_memcpy(packet.tau_preview_Nm, tau_preview_Nm, sizeof(float)*10);
    mav_array_memcpy(packet.theta_preview_rad, theta_preview_rad, sizeof(float)*10);
    mav_array_memcpy(packet.omega_preview_rad_s, omega_preview_rad_s, sizeof(float)*10);
        memcpy(_MAV_PAYLOAD_NON_CONST(msg), &packet, MAVLINK_MSG_ID_ESEA_CONTROL_IN_LEN);
#endif

    msg->msgid = MAVLINK_MSG_ID_ESEA_CONTROL_IN;
#if MAVLINK_CRC_EXTRA
    return mavlink_finalize_message_buffer(msg, system_id, component_id, _status, MAVLINK_MSG_ID_ESEA_CONTROL_IN_MIN_LEN, MAVLINK_MSG_ID_ESEA_CONTROL_IN_LEN, MAVLINK_MSG_ID_ESEA_CONTROL_IN_CRC);
#else
    return mavlink_finalize_message_buffer(msg, system_id, component_id, _status, MAVLINK_MSG_ID_ESEA_CONTROL_IN_MIN_LEN, MAVLINK_MSG_ID_ESEA_CONTROL_IN_LEN);
#endif
}

/**
 * @brief Pack a esea_control_in message on a channel
 * @param system_id ID of this system
 * @param component_id ID of this component (e.g. 200 for IMU)
 * @param chan The MAVLink channel this message will be sent over
 * @param msg The MAVLink message to compress the data into
 * @param sequence  Base tick of this run of the task.
 * @param tau_preview_Nm  wanted torque at the intervals' ends; 10 elements; [Nm], range -20 to 20
 * @param theta_preview_rad [rad] wanted angle; 10 elements; [rad], range -0.949999988 to 3.3499999
 * @param omega_preview_rad_s [rad/s] wanted rate; 10 elements; [rad/s], range -12 to 12
 * @return length of the message in bytes (excluding serial stream start sign)
 */
static inline uint16_t mavlink_msg_esea_control_in_pack_chan(uint8_t system_id, uint8_t component_id, uint8_t chan,
                               mavlink_message_t* msg,
                                   uint32_t sequence,const float *tau_preview_Nm,const float *theta_preview_rad,const float *omega_preview_rad_s)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    char buf[MAVLINK_MSG_ID_ESEA_CONTROL_IN_LEN];
    _mav_put_uint32_t(buf, 0, sequence);
    _mav_put_float_array(buf, 4, tau_preview_Nm, 10);
    _mav_put_float_array(buf, 44, theta_preview_rad, 10);
    _mav_put_float_array(buf, 84, omega_preview_rad_s, 10);
        memcpy(_MAV_PAYLOAD_NON_CONST(msg), buf, MAVLINK_MSG_ID_ESEA_CONTROL_IN_LEN);
#else
    mavlink_esea_control_in_t packet;
    packet.sequence = sequence;
    mav_array_memcpy(packet.tau_preview_Nm, tau_preview_Nm, sizeof(float)*10);
    mav_array_memcpy(packet.theta_preview_rad, theta_preview_rad, sizeof(float)*10);
    mav_array_memcpy(packet.omega_preview_rad_s, omega_preview_rad_s, sizeof(float)*10);
        memcpy(_MAV_PAYLOAD_NON_CONST(msg), &packet, MAVLINK_MSG_ID_ESEA_CONTROL_IN_LEN);
#endif

    msg->msgid = MAVLINK_MSG_ID_ESEA_CONTROL_IN;
    return mavlink_finalize_message_chan(msg, system_id, component_id, chan, MAVLINK_MSG_ID_ESEA_CONTROL_IN_MIN_LEN, MAVLINK_MSG_ID_ESEA_CONTROL_IN_LEN, MAVLINK_MSG_ID_ESEA_CONTROL_IN_CRC);
}

/**
 * @brief Encode a esea_control_in struct
 *
 * @param system_id ID of this system
 * @param component_id ID of this component (e.g. 200 for IMU)
 * @param msg The MAVLink message to compress the data into
 * @param esea_control_in C-struct to read the message contents from
 */
static inline uint16_t mavlink_msg_esea_control_in_encode(uint8_t system_id, uint8_t component_id, mavlink_message_t* msg, const mavlink_esea_control_in_t* esea_control_in)
{
    return mavlink_msg_esea_control_in_pack(system_id, component_id, msg, esea_control_in->sequence, esea_control_in->tau_preview_Nm, esea_control_in->theta_preview_rad, esea_control_in->omega_preview_rad_s);
}

/**
 * @brief Encode a esea_control_in struct on a channel
 *
 * @param system_id ID of this system
 * @param component_id ID of this component (e.g. 200 for IMU)
 * @param chan The MAVLink channel this message will be sent over
 * @param msg The MAVLink message to compress the data into
 * @param esea_control_in C-struct to read the message contents from
 */
static inline uint16_t mavlink_msg_esea_control_in_encode_chan(uint8_t system_id, uint8_t component_id, uint8_t chan, mavlink_message_t* msg, const mavlink_esea_control_in_t* esea_control_in)
{
    return mavlink_msg_esea_control_in_pack_chan(system_id, component_id, chan, msg, esea_control_in->sequence, esea_control_in->tau_preview_Nm, esea_control_in->theta_preview_rad, esea_control_in->omega_preview_rad_s);
}

/**
 * @brief Encode a esea_control_in struct with provided status structure
 *
 * @param system_id ID of this system
 * @param component_id ID of this component (e.g. 200 for IMU)
 * @param status MAVLink status structure
 * @param msg The MAVLink message to compress the data into
 * @param esea_control_in C-struct to read the message contents from
 */
static inline uint16_t mavlink_msg_esea_control_in_encode_status(uint8_t system_id, uint8_t component_id, mavlink_status_t* _status, mavlink_message_t* msg, const mavlink_esea_control_in_t* esea_control_in)
{
    return mavlink_msg_esea_control_in_pack_status(system_id, component_id, _status, msg,  esea_control_in->sequence, esea_control_in->tau_preview_Nm, esea_control_in->theta_preview_rad, esea_control_in->omega_preview_rad_s);
}

/**
 * @brief Send a esea_control_in message
 * @param chan MAVLink channel to send the message
 *
 * @param sequence  Base tick of this run of the task.
 * @param tau_preview_Nm  wanted torque at the intervals' ends; 10 elements; [Nm], range -20 to 20
 * @param theta_preview_rad [rad] wanted angle; 10 elements; [rad], range -0.949999988 to 3.3499999
 * @param omega_preview_rad_s [rad/s] wanted rate; 10 elements; [rad/s], range -12 to 12
 */
#ifdef MAVLINK_USE_CONVENIENCE_FUNCTIONS

static inline void mavlink_msg_esea_control_in_send(mavlink_channel_t chan, uint32_t sequence, const float *tau_preview_Nm, const float *theta_preview_rad, const float *omega_preview_rad_s)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    char buf[MAVLINK_MSG_ID_ESEA_CONTROL_IN_LEN];
    _mav_put_uint32_t(buf, 0, sequence);
    _mav_put_float_array(buf, 4, tau_preview_Nm, 10);
    _mav_put_float_array(buf, 44, theta_preview_rad, 10);
    _mav_put_float_array(buf, 84, omega_preview_rad_s, 10);
    _mav_finalize_message_chan_send(chan, MAVLINK_MSG_ID_ESEA_CONTROL_IN, buf, MAVLINK_MSG_ID_ESEA_CONTROL_IN_MIN_LEN, MAVLINK_MSG_ID_ESEA_CONTROL_IN_LEN, MAVLINK_MSG_ID_ESEA_CONTROL_IN_CRC);
#else
    mavlink_esea_control_in_t packet;
    packet.sequence = sequence;
    mav_array_memcpy(packet.tau_preview_Nm, tau_preview_Nm, sizeof(float)*10);
    mav_array_memcpy(packet.theta_preview_rad, theta_preview_rad, sizeof(float)*10);
    mav_array_memcpy(packet.omega_preview_rad_s, omega_preview_rad_s, sizeof(float)*10);
    _mav_finalize_message_chan_send(chan, MAVLINK_MSG_ID_ESEA_CONTROL_IN, (const char *)&packet, MAVLINK_MSG_ID_ESEA_CONTROL_IN_MIN_LEN, MAVLINK_MSG_ID_ESEA_CONTROL_IN_LEN, MAVLINK_MSG_ID_ESEA_CONTROL_IN_CRC);
#endif
}

/**
 * @brief Send a esea_control_in message
 * @param chan MAVLink channel to send the message
 * @param struct The MAVLink struct to serialize
 */
static inline void mavlink_msg_esea_control_in_send_struct(mavlink_channel_t chan, const mavlink_esea_control_in_t* esea_control_in)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    mavlink_msg_esea_control_in_send(chan, esea_control_in->sequence, esea_control_in->tau_preview_Nm, esea_control_in->theta_preview_rad, esea_control_in->omega_preview_rad_s);
#else
    _mav_finalize_message_chan_send(chan, MAVLINK_MSG_ID_ESEA_CONTROL_IN, (const char *)esea_control_in, MAVLINK_MSG_ID_ESEA_CONTROL_IN_MIN_LEN, MAVLINK_MSG_ID_ESEA_CONTROL_IN_LEN, MAVLINK_MSG_ID_ESEA_CONTROL_IN_CRC);
#endif
}

#if MAVLINK_MSG_ID_ESEA_CONTROL_IN_LEN <= MAVLINK_MAX_PAYLOAD_LEN
/*
  This variant of _send() can be used to save stack space by reusing
  memory from the receive buffer.  The caller provides a
  mavlink_message_t which is the size of a full mavlink message. This
  is usually the receive buffer for the channel, and allows a reply to an
  incoming message with minimum stack space usage.
 */
static inline void mavlink_msg_esea_control_in_send_buf(mavlink_message_t *msgbuf, mavlink_channel_t chan,  uint32_t sequence, const float *tau_preview_Nm, const float *theta_preview_rad, const float *omega_preview_rad_s)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    char *buf = (char *)msgbuf;
    _mav_put_uint32_t(buf, 0, sequence);
    _mav_put_float_array(buf, 4, tau_preview_Nm, 10);
    _mav_put_float_array(buf, 44, theta_preview_rad, 10);
    _mav_put_float_array(buf, 84, omega_preview_rad_s, 10);
    _mav_finalize_message_chan_send(chan, MAVLINK_MSG_ID_ESEA_CONTROL_IN, buf, MAVLINK_MSG_ID_ESEA_CONTROL_IN_MIN_LEN, MAVLINK_MSG_ID_ESEA_CONTROL_IN_LEN, MAVLINK_MSG_ID_ESEA_CONTROL_IN_CRC);
#else
    mavlink_esea_control_in_t *packet = (mavlink_esea_control_in_t *)msgbuf;
    packet->sequence = sequence;
    mav_array_memcpy(packet->tau_preview_Nm, tau_preview_Nm, sizeof(float)*10);
    mav_array_memcpy(packet->theta_preview_rad, theta_preview_rad, sizeof(float)*10);
    mav_array_memcpy(packet->omega_preview_rad_s, omega_preview_rad_s, sizeof(float)*10);
    _mav_finalize_message_chan_send(chan, MAVLINK_MSG_ID_ESEA_CONTROL_IN, (const char *)packet, MAVLINK_MSG_ID_ESEA_CONTROL_IN_MIN_LEN, MAVLINK_MSG_ID_ESEA_CONTROL_IN_LEN, MAVLINK_MSG_ID_ESEA_CONTROL_IN_CRC);
#endif
}
#endif

#endif

// MESSAGE ESEA_CONTROL_IN UNPACKING


/**
 * @brief Get field sequence from esea_control_in message
 *
 * @return  Base tick of this run of the task.
 */
static inline uint32_t mavlink_msg_esea_control_in_get_sequence(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint32_t(msg,  0);
}

/**
 * @brief Get field tau_preview_Nm from esea_control_in message
 *
 * @return  wanted torque at the intervals' ends; 10 elements; [Nm], range -20 to 20
 */
static inline uint16_t mavlink_msg_esea_control_in_get_tau_preview_Nm(const mavlink_message_t* msg, float *tau_preview_Nm)
{
    return _MAV_RETURN_float_array(msg, tau_preview_Nm, 10,  4);
}

/**
 * @brief Get field theta_preview_rad from esea_control_in message
 *
 * @return [rad] wanted angle; 10 elements; [rad], range -0.949999988 to 3.3499999
 */
static inline uint16_t mavlink_msg_esea_control_in_get_theta_preview_rad(const mavlink_message_t* msg, float *theta_preview_rad)
{
    return _MAV_RETURN_float_array(msg, theta_preview_rad, 10,  44);
}

/**
 * @brief Get field omega_preview_rad_s from esea_control_in message
 *
 * @return [rad/s] wanted rate; 10 elements; [rad/s], range -12 to 12
 */
static inline uint16_t mavlink_msg_esea_control_in_get_omega_preview_rad_s(const mavlink_message_t* msg, float *omega_preview_rad_s)
{
    return _MAV_RETURN_float_array(msg, omega_preview_rad_s, 10,  84);
}

/**
 * @brief Decode a esea_control_in message into a struct
 *
 * @param msg The message to decode
 * @param esea_control_in C-struct to decode the message contents into
 */
static inline void mavlink_msg_esea_control_in_decode(const mavlink_message_t* msg, mavlink_esea_control_in_t* esea_control_in)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    esea_control_in->sequence = mavlink_msg_esea_control_in_get_sequence(msg);
    mavlink_msg_esea_control_in_get_tau_preview_Nm(msg, esea_control_in->tau_preview_Nm);
    mavlink_msg_esea_control_in_get_theta_preview_rad(msg, esea_control_in->theta_preview_rad);
    mavlink_msg_esea_control_in_get_omega_preview_rad_s(msg, esea_control_in->omega_preview_rad_s);
#else
        uint8_t len = msg->len < MAVLINK_MSG_ID_ESEA_CONTROL_IN_LEN? msg->len : MAVLINK_MSG_ID_ESEA_CONTROL_IN_LEN;
        memset(esea_control_in, 0, MAVLINK_MSG_ID_ESEA_CONTROL_IN_LEN);
    memcpy(esea_control_in, _MAV_PAYLOAD(msg), len);
#endif
}
