#pragma once
// MESSAGE ESEA_WANTED PACKING

#include <stdint.h>

#define MAVLINK_MSG_ID_ESEA_WANTED 42660


typedef struct __mavlink_esea_wanted_t {
 float mode; /*<  0 off, 1 torque, 2 impedance (rounded); [dimensionless], range 0 to 2*/
 float tau_desired_Nm; /*<  wanted interaction torque; [Nm], range -20 to 20*/
 float theta_desired_rad; /*< [rad] wanted angle of the joint; [rad], range -0.949999988 to 3.3499999*/
 float omega_desired_rad_s; /*< [rad/s] wanted rate of the joint; [rad/s], range -12 to 12*/
 uint32_t boot; /*<  Number of this start of the board, never 0.*/
 uint32_t time_ms; /*< [ms] Device clock, at 0 again after 49.7 days.*/
 uint16_t deadline_ms; /*< [ms] When the next one must have come, or the board lets go: 20 to 1000, what is outside is held there; 0: 100.*/
} mavlink_esea_wanted_t;

#define MAVLINK_MSG_ID_ESEA_WANTED_LEN 26
#define MAVLINK_MSG_ID_ESEA_WANTED_MIN_LEN 26
#define MAVLINK_MSG_ID_42660_LEN 26
#define MAVLINK_MSG_ID_42660_MIN_LEN 26

#define MAVLINK_MSG_ID_ESEA_WANTED_CRC 229
#define MAVLINK_MSG_ID_42660_CRC 229



#if MAVLINK_COMMAND_24BIT
#define MAVLINK_MESSAGE_INFO_ESEA_WANTED { \
    42660, \
    "ESEA_WANTED", \
    7, \
    {  { "mode", NULL, MAVLINK_TYPE_FLOAT, 0, 0, offsetof(mavlink_esea_wanted_t, mode) }, \
         { "tau_desired_Nm", NULL, MAVLINK_TYPE_FLOAT, 0, 4, offsetof(mavlink_esea_wanted_t, tau_desired_Nm) }, \
         { "theta_desired_rad", NULL, MAVLINK_TYPE_FLOAT, 0, 8, offsetof(mavlink_esea_wanted_t, theta_desired_rad) }, \
         { "omega_desired_rad_s", NULL, MAVLINK_TYPE_FLOAT, 0, 12, offsetof(mavlink_esea_wanted_t, omega_desired_rad_s) }, \
         { "deadline_ms", NULL, MAVLINK_TYPE_UINT16_T, 0, 24, offsetof(mavlink_esea_wanted_t, deadline_ms) }, \
         { "boot", NULL, MAVLINK_TYPE_UINT32_T, 0, 16, offsetof(mavlink_esea_wanted_t, boot) }, \
         { "time_ms", NULL, MAVLINK_TYPE_UINT32_T, 0, 20, offsetof(mavlink_esea_wanted_t, time_ms) }, \
         } \
}
#else
#define MAVLINK_MESSAGE_INFO_ESEA_WANTED { \
    "ESEA_WANTED", \
    7, \
    {  { "mode", NULL, MAVLINK_TYPE_FLOAT, 0, 0, offsetof(mavlink_esea_wanted_t, mode) }, \
         { "tau_desired_Nm", NULL, MAVLINK_TYPE_FLOAT, 0, 4, offsetof(mavlink_esea_wanted_t, tau_desired_Nm) }, \
         { "theta_desired_rad", NULL, MAVLINK_TYPE_FLOAT, 0, 8, offsetof(mavlink_esea_wanted_t, theta_desired_rad) }, \
         { "omega_desired_rad_s", NULL, MAVLINK_TYPE_FLOAT, 0, 12, offsetof(mavlink_esea_wanted_t, omega_desired_rad_s) }, \
         { "deadline_ms", NULL, MAVLINK_TYPE_UINT16_T, 0, 24, offsetof(mavlink_esea_wanted_t, deadline_ms) }, \
         { "boot", NULL, MAVLINK_TYPE_UINT32_T, 0, 16, offsetof(mavlink_esea_wanted_t, boot) }, \
         { "time_ms", NULL, MAVLINK_TYPE_UINT32_T, 0, 20, offsetof(mavlink_esea_wanted_t, time_ms) }, \
         } \
}
#endif

/**
 * @brief Pack a esea_wanted message
 * @param system_id ID of this system
 * @param component_id ID of this component (e.g. 200 for IMU)
 * @param msg The MAVLink message to compress the data into
 *
 * @param mode  0 off, 1 torque, 2 impedance (rounded); [dimensionless], range 0 to 2
 * @param tau_desired_Nm  wanted interaction torque; [Nm], range -20 to 20
 * @param theta_desired_rad [rad] wanted angle of the joint; [rad], range -0.949999988 to 3.3499999
 * @param omega_desired_rad_s [rad/s] wanted rate of the joint; [rad/s], range -12 to 12
 * @param deadline_ms [ms] When the next one must have come, or the board lets go: 20 to 1000, what is outside is held there; 0: 100.
 * @param boot  Number of this start of the board, never 0.
 * @param time_ms [ms] Device clock, at 0 again after 49.7 days.
 * @return length of the message in bytes (excluding serial stream start sign)
 */
static inline uint16_t mavlink_msg_esea_wanted_pack(uint8_t system_id, uint8_t component_id, mavlink_message_t* msg,
                               float mode, float tau_desired_Nm, float theta_desired_rad, float omega_desired_rad_s, uint16_t deadline_ms, uint32_t boot, uint32_t time_ms)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    char buf[MAVLINK_MSG_ID_ESEA_WANTED_LEN];
    _mav_put_float(buf, 0, mode);
    _mav_put_float(buf, 4, tau_desired_Nm);
    _mav_put_float(buf, 8, theta_desired_rad);
    _mav_put_float(buf, 12, omega_desired_rad_s);
    _mav_put_uint32_t(buf, 16, boot);
    _mav_put_uint32_t(buf, 20, time_ms);
    _mav_put_uint16_t(buf, 24, deadline_ms);

        memcpy(_MAV_PAYLOAD_NON_CONST(msg), buf, MAVLINK_MSG_ID_ESEA_WANTED_LEN);
#else
    mavlink_esea_wanted_t packet;
    packet.mode = mode;
    packet.tau_desired_Nm = tau_desired_Nm;
    packet.theta_desired_rad = theta_desired_rad;
    packet.omega_desired_rad_s = omega_desired_rad_s;
    packet.boot = boot;
    packet.time_ms = time_ms;
    packet.deadline_ms = deadline_ms;

        memcpy(_MAV_PAYLOAD_NON_CONST(msg), &packet, MAVLINK_MSG_ID_ESEA_WANTED_LEN);
#endif

    msg->msgid = MAVLINK_MSG_ID_ESEA_WANTED;
    return mavlink_finalize_message(msg, system_id, component_id, MAVLINK_MSG_ID_ESEA_WANTED_MIN_LEN, MAVLINK_MSG_ID_ESEA_WANTED_LEN, MAVLINK_MSG_ID_ESEA_WANTED_CRC);
}

/**
 * @brief Pack a esea_wanted message
 * @param system_id ID of this system
 * @param component_id ID of this component (e.g. 200 for IMU)
 * @param status MAVLink status structure
 * @param msg The MAVLink message to compress the data into
 *
 * @param mode  0 off, 1 torque, 2 impedance (rounded); [dimensionless], range 0 to 2
 * @param tau_desired_Nm  wanted interaction torque; [Nm], range -20 to 20
 * @param theta_desired_rad [rad] wanted angle of the joint; [rad], range -0.949999988 to 3.3499999
 * @param omega_desired_rad_s [rad/s] wanted rate of the joint; [rad/s], range -12 to 12
 * @param deadline_ms [ms] When the next one must have come, or the board lets go: 20 to 1000, what is outside is held there; 0: 100.
 * @param boot  Number of this start of the board, never 0.
 * @param time_ms [ms] Device clock, at 0 again after 49.7 days.
 * @return length of the message in bytes (excluding serial stream start sign)
 */
static inline uint16_t mavlink_msg_esea_wanted_pack_status(uint8_t system_id, uint8_t component_id, mavlink_status_t *_status, mavlink_message_t* msg,
                               float mode, float tau_desired_Nm, float theta_desired_rad, float omega_desired_rad_s, uint16_t deadline_ms, uint32_t boot, uint32_t time_ms)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    char buf[MAVLINK_MSG_ID_ESEA_WANTED_LEN];
    _mav_put_float(buf, 0, mode);
    _mav_put_float(buf, 4, tau_desired_Nm);
    _mav_put_float(buf, 8, theta_desired_rad);
    _mav_put_float(buf, 12, omega_desired_rad_s);
    _mav_put_uint32_t(buf, 16, boot);
    _mav_put_uint32_t(buf, 20, time_ms);
    _mav_put_uint16_t(buf, 24, deadline_ms);

        memcpy(_MAV_PAYLOAD_NON_CONST(msg), buf, MAVLINK_MSG_ID_ESEA_WANTED_LEN);
#else
    mavlink_esea_wanted_t packet;
    packet.mode = mode;
    packet.tau_desired_Nm = tau_desired_Nm;
    packet.theta_desired_rad = theta_desired_rad;
    packet.omega_desired_rad_s = omega_desired_rad_s;
    packet.boot = boot;
    packet.time_ms = time_ms;
    packet.deadline_ms = deadline_ms;

        memcpy(_MAV_PAYLOAD_NON_CONST(msg), &packet, MAVLINK_MSG_ID_ESEA_WANTED_LEN);
#endif

    msg->msgid = MAVLINK_MSG_ID_ESEA_WANTED;
#if MAVLINK_CRC_EXTRA
    return mavlink_finalize_message_buffer(msg, system_id, component_id, _status, MAVLINK_MSG_ID_ESEA_WANTED_MIN_LEN, MAVLINK_MSG_ID_ESEA_WANTED_LEN, MAVLINK_MSG_ID_ESEA_WANTED_CRC);
#else
    return mavlink_finalize_message_buffer(msg, system_id, component_id, _status, MAVLINK_MSG_ID_ESEA_WANTED_MIN_LEN, MAVLINK_MSG_ID_ESEA_WANTED_LEN);
#endif
}

/**
 * @brief Pack a esea_wanted message on a channel
 * @param system_id ID of this system
 * @param component_id ID of this component (e.g. 200 for IMU)
 * @param chan The MAVLink channel this message will be sent over
 * @param msg The MAVLink message to compress the data into
 * @param mode  0 off, 1 torque, 2 impedance (rounded); [dimensionless], range 0 to 2
 * @param tau_desired_Nm  wanted interaction torque; [Nm], range -20 to 20
 * @param theta_desired_rad [rad] wanted angle of the joint; [rad], range -0.949999988 to 3.3499999
 * @param omega_desired_rad_s [rad/s] wanted rate of the joint; [rad/s], range -12 to 12
 * @param deadline_ms [ms] When the next one must have come, or the board lets go: 20 to 1000, what is outside is held there; 0: 100.
 * @param boot  Number of this start of the board, never 0.
 * @param time_ms [ms] Device clock, at 0 again after 49.7 days.
 * @return length of the message in bytes (excluding serial stream start sign)
 */
static inline uint16_t mavlink_msg_esea_wanted_pack_chan(uint8_t system_id, uint8_t component_id, uint8_t chan,
                               mavlink_message_t* msg,
                                   float mode,float tau_desired_Nm,float theta_desired_rad,float omega_desired_rad_s,uint16_t deadline_ms,uint32_t boot,uint32_t time_ms)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    char buf[MAVLINK_MSG_ID_ESEA_WANTED_LEN];
    _mav_put_float(buf, 0, mode);
    _mav_put_float(buf, 4, tau_desired_Nm);
    _mav_put_float(buf, 8, theta_desired_rad);
    _mav_put_float(buf, 12, omega_desired_rad_s);
    _mav_put_uint32_t(buf, 16, boot);
    _mav_put_uint32_t(buf, 20, time_ms);
    _mav_put_uint16_t(buf, 24, deadline_ms);

        memcpy(_MAV_PAYLOAD_NON_CONST(msg), buf, MAVLINK_MSG_ID_ESEA_WANTED_LEN);
#else
    mavlink_esea_wanted_t packet;
    packet.mode = mode;
    packet.tau_desired_Nm = tau_desired_Nm;
    packet.theta_desired_rad = theta_desired_rad;
    packet.omega_desired_rad_s = omega_desired_rad_s;
    packet.boot = boot;
    packet.time_ms = time_ms;
    packet.deadline_ms = deadline_ms;

        memcpy(_MAV_PAYLOAD_NON_CONST(msg), &packet, MAVLINK_MSG_ID_ESEA_WANTED_LEN);
#endif

    msg->msgid = MAVLINK_MSG_ID_ESEA_WANTED;
    return mavlink_finalize_message_chan(msg, system_id, component_id, chan, MAVLINK_MSG_ID_ESEA_WANTED_MIN_LEN, MAVLINK_MSG_ID_ESEA_WANTED_LEN, MAVLINK_MSG_ID_ESEA_WANTED_CRC);
}

/**
 * @brief Encode a esea_wanted struct
 *
 * @param system_id ID of this system
 * @param component_id ID of this component (e.g. 200 for IMU)
 * @param msg The MAVLink message to compress the data into
 * @param esea_wanted C-struct to read the message contents from
 */
static inline uint16_t mavlink_msg_esea_wanted_encode(uint8_t system_id, uint8_t component_id, mavlink_message_t* msg, const mavlink_esea_wanted_t* esea_wanted)
{
    return mavlink_msg_esea_wanted_pack(system_id, component_id, msg, esea_wanted->mode, esea_wanted->tau_desired_Nm, esea_wanted->theta_desired_rad, esea_wanted->omega_desired_rad_s, esea_wanted->deadline_ms, esea_wanted->boot, esea_wanted->time_ms);
}

/**
 * @brief Encode a esea_wanted struct on a channel
 *
 * @param system_id ID of this system
 * @param component_id ID of this component (e.g. 200 for IMU)
 * @param chan The MAVLink channel this message will be sent over
 * @param msg The MAVLink message to compress the data into
 * @param esea_wanted C-struct to read the message contents from
 */
static inline uint16_t mavlink_msg_esea_wanted_encode_chan(uint8_t system_id, uint8_t component_id, uint8_t chan, mavlink_message_t* msg, const mavlink_esea_wanted_t* esea_wanted)
{
    return mavlink_msg_esea_wanted_pack_chan(system_id, component_id, chan, msg, esea_wanted->mode, esea_wanted->tau_desired_Nm, esea_wanted->theta_desired_rad, esea_wanted->omega_desired_rad_s, esea_wanted->deadline_ms, esea_wanted->boot, esea_wanted->time_ms);
}

/**
 * @brief Encode a esea_wanted struct with provided status structure
 *
 * @param system_id ID of this system
 * @param component_id ID of this component (e.g. 200 for IMU)
 * @param status MAVLink status structure
 * @param msg The MAVLink message to compress the data into
 * @param esea_wanted C-struct to read the message contents from
 */
static inline uint16_t mavlink_msg_esea_wanted_encode_status(uint8_t system_id, uint8_t component_id, mavlink_status_t* _status, mavlink_message_t* msg, const mavlink_esea_wanted_t* esea_wanted)
{
    return mavlink_msg_esea_wanted_pack_status(system_id, component_id, _status, msg,  esea_wanted->mode, esea_wanted->tau_desired_Nm, esea_wanted->theta_desired_rad, esea_wanted->omega_desired_rad_s, esea_wanted->deadline_ms, esea_wanted->boot, esea_wanted->time_ms);
}

/**
 * @brief Send a esea_wanted message
 * @param chan MAVLink channel to send the message
 *
 * @param mode  0 off, 1 torque, 2 impedance (rounded); [dimensionless], range 0 to 2
 * @param tau_desired_Nm  wanted interaction torque; [Nm], range -20 to 20
 * @param theta_desired_rad [rad] wanted angle of the joint; [rad], range -0.949999988 to 3.3499999
 * @param omega_desired_rad_s [rad/s] wanted rate of the joint; [rad/s], range -12 to 12
 * @param deadline_ms [ms] When the next one must have come, or the board lets go: 20 to 1000, what is outside is held there; 0: 100.
 * @param boot  Number of this start of the board, never 0.
 * @param time_ms [ms] Device clock, at 0 again after 49.7 days.
 */
#ifdef MAVLINK_USE_CONVENIENCE_FUNCTIONS

static inline void mavlink_msg_esea_wanted_send(mavlink_channel_t chan, float mode, float tau_desired_Nm, float theta_desired_rad, float omega_desired_rad_s, uint16_t deadline_ms, uint32_t boot, uint32_t time_ms)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    char buf[MAVLINK_MSG_ID_ESEA_WANTED_LEN];
    _mav_put_float(buf, 0, mode);
    _mav_put_float(buf, 4, tau_desired_Nm);
    _mav_put_float(buf, 8, theta_desired_rad);
    _mav_put_float(buf, 12, omega_desired_rad_s);
    _mav_put_uint32_t(buf, 16, boot);
    _mav_put_uint32_t(buf, 20, time_ms);
    _mav_put_uint16_t(buf, 24, deadline_ms);

    _mav_finalize_message_chan_send(chan, MAVLINK_MSG_ID_ESEA_WANTED, buf, MAVLINK_MSG_ID_ESEA_WANTED_MIN_LEN, MAVLINK_MSG_ID_ESEA_WANTED_LEN, MAVLINK_MSG_ID_ESEA_WANTED_CRC);
#else
    mavlink_esea_wanted_t packet;
    packet.mode = mode;
    packet.tau_desired_Nm = tau_desired_Nm;
    packet.theta_desired_rad = theta_desired_rad;
    packet.omega_desired_rad_s = omega_desired_rad_s;
    packet.boot = boot;
    packet.time_ms = time_ms;
    packet.deadline_ms = deadline_ms;

    _mav_finalize_message_chan_send(chan, MAVLINK_MSG_ID_ESEA_WANTED, (const char *)&packet, MAVLINK_MSG_ID_ESEA_WANTED_MIN_LEN, MAVLINK_MSG_ID_ESEA_WANTED_LEN, MAVLINK_MSG_ID_ESEA_WANTED_CRC);
#endif
}

/**
 * @brief Send a esea_wanted message
 * @param chan MAVLink channel to send the message
 * @param struct The MAVLink struct to serialize
 */
static inline void mavlink_msg_esea_wanted_send_struct(mavlink_channel_t chan, const mavlink_esea_wanted_t* esea_wanted)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    mavlink_msg_esea_wanted_send(chan, esea_wanted->mode, esea_wanted->tau_desired_Nm, esea_wanted->theta_desired_rad, esea_wanted->omega_desired_rad_s, esea_wanted->deadline_ms, esea_wanted->boot, esea_wanted->time_ms);
#else
    _mav_finalize_message_chan_send(chan, MAVLINK_MSG_ID_ESEA_WANTED, (const char *)esea_wanted, MAVLINK_MSG_ID_ESEA_WANTED_MIN_LEN, MAVLINK_MSG_ID_ESEA_WANTED_LEN, MAVLINK_MSG_ID_ESEA_WANTED_CRC);
#endif
}

#if MAVLINK_MSG_ID_ESEA_WANTED_LEN <= MAVLINK_MAX_PAYLOAD_LEN
/*
  This variant of _send() can be used to save stack space by reusing
  memory from the receive buffer.  The caller provides a
  mavlink_message_t which is the size of a full mavlink message. This
  is usually the receive buffer for the channel, and allows a reply to an
  incoming message with minimum stack space usage.
 */
static inline void mavlink_msg_esea_wanted_send_buf(mavlink_message_t *msgbuf, mavlink_channel_t chan,  float mode, float tau_desired_Nm, float theta_desired_rad, float omega_desired_rad_s, uint16_t deadline_ms, uint32_t boot, uint32_t time_ms)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    char *buf = (char *)msgbuf;
    _mav_put_float(buf, 0, mode);
    _mav_put_float(buf, 4, tau_desired_Nm);
    _mav_put_float(buf, 8, theta_desired_rad);
    _mav_put_float(buf, 12, omega_desired_rad_s);
    _mav_put_uint32_t(buf, 16, boot);
    _mav_put_uint32_t(buf, 20, time_ms);
    _mav_put_uint16_t(buf, 24, deadline_ms);

    _mav_finalize_message_chan_send(chan, MAVLINK_MSG_ID_ESEA_WANTED, buf, MAVLINK_MSG_ID_ESEA_WANTED_MIN_LEN, MAVLINK_MSG_ID_ESEA_WANTED_LEN, MAVLINK_MSG_ID_ESEA_WANTED_CRC);
#else
    mavlink_esea_wanted_t *packet = (mavlink_esea_wanted_t *)msgbuf;
    packet->mode = mode;
    packet->tau_desired_Nm = tau_desired_Nm;
    packet->theta_desired_rad = theta_desired_rad;
    packet->omega_desired_rad_s = omega_desired_rad_s;
    packet->boot = boot;
    packet->time_ms = time_ms;
    packet->deadline_ms = deadline_ms;

    _mav_finalize_message_chan_send(chan, MAVLINK_MSG_ID_ESEA_WANTED, (const char *)packet, MAVLINK_MSG_ID_ESEA_WANTED_MIN_LEN, MAVLINK_MSG_ID_ESEA_WANTED_LEN, MAVLINK_MSG_ID_ESEA_WANTED_CRC);
#endif
}
#endif

#endif

// MESSAGE ESEA_WANTED UNPACKING


/**
 * @brief Get field mode from esea_wanted message
 *
 * @return  0 off, 1 torque, 2 impedance (rounded); [dimensionless], range 0 to 2
 */
static inline float mavlink_msg_esea_wanted_get_mode(const mavlink_message_t* msg)
{
    return _MAV_RETURN_float(msg,  0);
}

/**
 * @brief Get field tau_desired_Nm from esea_wanted message
 *
 * @return  wanted interaction torque; [Nm], range -20 to 20
 */
static inline float mavlink_msg_esea_wanted_get_tau_desired_Nm(const mavlink_message_t* msg)
{
    return _MAV_RETURN_float(msg,  4);
}

/**
 * @brief Get field theta_desired_rad from esea_wanted message
 *
 * @return [rad] wanted angle of the joint; [rad], range -0.949999988 to 3.3499999
 */
static inline float mavlink_msg_esea_wanted_get_theta_desired_rad(const mavlink_message_t* msg)
{
    return _MAV_RETURN_float(msg,  8);
}

/**
 * @brief Get field omega_desired_rad_s from esea_wanted message
 *
 * @return [rad/s] wanted rate of the joint; [rad/s], range -12 to 12
 */
static inline float mavlink_msg_esea_wanted_get_omega_desired_rad_s(const mavlink_message_t* msg)
{
    return _MAV_RETURN_float(msg,  12);
}

/**
 * @brief Get field deadline_ms from esea_wanted message
 *
 * @return [ms] When the next one must have come, or the board lets go: 20 to 1000, what is outside is held there; 0: 100.
 */
static inline uint16_t mavlink_msg_esea_wanted_get_deadline_ms(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint16_t(msg,  24);
}

/**
 * @brief Get field boot from esea_wanted message
 *
 * @return  Number of this start of the board, never 0.
 */
static inline uint32_t mavlink_msg_esea_wanted_get_boot(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint32_t(msg,  16);
}

/**
 * @brief Get field time_ms from esea_wanted message
 *
 * @return [ms] Device clock, at 0 again after 49.7 days.
 */
static inline uint32_t mavlink_msg_esea_wanted_get_time_ms(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint32_t(msg,  20);
}

/**
 * @brief Decode a esea_wanted message into a struct
 *
 * @param msg The message to decode
 * @param esea_wanted C-struct to decode the message contents into
 */
static inline void mavlink_msg_esea_wanted_decode(const mavlink_message_t* msg, mavlink_esea_wanted_t* esea_wanted)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    esea_wanted->mode = mavlink_msg_esea_wanted_get_mode(msg);
    esea_wanted->tau_desired_Nm = mavlink_msg_esea_wanted_get_tau_desired_Nm(msg);
    esea_wanted->theta_desired_rad = mavlink_msg_esea_wanted_get_theta_desired_rad(msg);
    esea_wanted->omega_desired_rad_s = mavlink_msg_esea_wanted_get_omega_desired_rad_s(msg);
    esea_wanted->boot = mavlink_msg_esea_wanted_get_boot(msg);
    esea_wanted->time_ms = mavlink_msg_esea_wanted_get_time_ms(msg);
    esea_wanted->deadline_ms = mavlink_msg_esea_wanted_get_deadline_ms(msg);
#else
        uint8_t len = msg->len < MAVLINK_MSG_ID_ESEA_WANTED_LEN? msg->len : MAVLINK_MSG_ID_ESEA_WANTED_LEN;
        memset(esea_wanted, 0, MAVLINK_MSG_ID_ESEA_WANTED_LEN);
    memcpy(esea_wanted, _MAV_PAYLOAD(msg), len);
#endif
}
