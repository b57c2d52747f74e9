#pragma once
// MESSAGE ESEA_SENSE_IN PACKING

#include <stdint.h>

#define MAVLINK_MSG_ID_ESEA_SENSE_IN 42601


typedef struct __mavlink_esea_sense_in_t {
 uint32_t sequence; /*<  Base tick of this run of the task.*/
 float count_motor; /*<  raw count as the chip gives it, a whole number; [dimensionless], range 0 to 4095*/
 float frame_error_motor; /*<  what is wrong with the frame; 0 when good; [dimensionless], range 0 to 127*/
 float count_load; /*<  raw count as the chip gives it, a whole number; [dimensionless], range 0 to 4095*/
 float frame_error_load; /*<  what is wrong with the frame; 0 when good; [dimensionless], range 0 to 127*/
 float mode; /*<  0 off, 1 torque, 2 impedance (rounded); [dimensionless], range 0 to 2*/
 float stop; /*<  0 no, anything else stops; [dimensionless], range 0 to 1*/
 float rearm; /*<  whole number, one more for each request; 0 follows 7; [dimensionless], range 0 to 7*/
 float tau_desired_Nm; /*<  wanted interaction torque; [Nm], range -20 to 20*/
 float theta_desired_rad; /*< [rad] wanted angle of the joint; [rad], range -0.949999988 to 3.3499999*/
 float omega_desired_rad_s; /*< [rad/s] wanted rate of the joint; [rad/s], range -12 to 12*/
 float count_gear; /*<  raw count of the shaft, a whole number; [dimensionless], range 0 to 131071*/
 float frame_error_gear; /*<  what is wrong with the frame; 0 when good; [dimensionless], range 0 to 127*/
} mavlink_esea_sense_in_t;

#define MAVLINK_MSG_ID_ESEA_SENSE_IN_LEN 52
#define MAVLINK_MSG_ID_ESEA_SENSE_IN_MIN_LEN 52
#define MAVLINK_MSG_ID_42601_LEN 52
#define MAVLINK_MSG_ID_42601_MIN_LEN 52

#define MAVLINK_MSG_ID_ESEA_SENSE_IN_CRC 57
#define MAVLINK_MSG_ID_42601_CRC 57



#if MAVLINK_COMMAND_24BIT
#define MAVLINK_MESSAGE_INFO_ESEA_SENSE_IN { \
    42601, \
    "ESEA_SENSE_IN", \
    13, \
    {  { "sequence", NULL, MAVLINK_TYPE_UINT32_T, 0, 0, offsetof(mavlink_esea_sense_in_t, sequence) }, \
         { "count_motor", NULL, MAVLINK_TYPE_FLOAT, 0, 4, offsetof(mavlink_esea_sense_in_t, count_motor) }, \
         { "frame_error_motor", NULL, MAVLINK_TYPE_FLOAT, 0, 8, offsetof(mavlink_esea_sense_in_t, frame_error_motor) }, \
         { "count_load", NULL, MAVLINK_TYPE_FLOAT, 0, 12, offsetof(mavlink_esea_sense_in_t, count_load) }, \
         { "frame_error_load", NULL, MAVLINK_TYPE_FLOAT, 0, 16, offsetof(mavlink_esea_sense_in_t, frame_error_load) }, \
         { "mode", NULL, MAVLINK_TYPE_FLOAT, 0, 20, offsetof(mavlink_esea_sense_in_t, mode) }, \
         { "stop", NULL, MAVLINK_TYPE_FLOAT, 0, 24, offsetof(mavlink_esea_sense_in_t, stop) }, \
         { "rearm", NULL, MAVLINK_TYPE_FLOAT, 0, 28, offsetof(mavlink_esea_sense_in_t, rearm) }, \
         { "tau_desired_Nm", NULL, MAVLINK_TYPE_FLOAT, 0, 32, offsetof(mavlink_esea_sense_in_t, tau_desired_Nm) }, \
         { "theta_desired_rad", NULL, MAVLINK_TYPE_FLOAT, 0, 36, offsetof(mavlink_esea_sense_in_t, theta_desired_rad) }, \
         { "omega_desired_rad_s", NULL, MAVLINK_TYPE_FLOAT, 0, 40, offsetof(mavlink_esea_sense_in_t, omega_desired_rad_s) }, \
         { "count_gear", NULL, MAVLINK_TYPE_FLOAT, 0, 44, offsetof(mavlink_esea_sense_in_t, count_gear) }, \
         { "frame_error_gear", NULL, MAVLINK_TYPE_FLOAT, 0, 48, offsetof(mavlink_esea_sense_in_t, frame_error_gear) }, \
         } \
}
#else
#define MAVLINK_MESSAGE_INFO_ESEA_SENSE_IN { \
    "ESEA_SENSE_IN", \
    13, \
    {  { "sequence", NULL, MAVLINK_TYPE_UINT32_T, 0, 0, offsetof(mavlink_esea_sense_in_t, sequence) }, \
         { "count_motor", NULL, MAVLINK_TYPE_FLOAT, 0, 4, offsetof(mavlink_esea_sense_in_t, count_motor) }, \
         { "frame_error_motor", NULL, MAVLINK_TYPE_FLOAT, 0, 8, offsetof(mavlink_esea_sense_in_t, frame_error_motor) }, \
         { "count_load", NULL, MAVLINK_TYPE_FLOAT, 0, 12, offsetof(mavlink_esea_sense_in_t, count_load) }, \
         { "frame_error_load", NULL, MAVLINK_TYPE_FLOAT, 0, 16, offsetof(mavlink_esea_sense_in_t, frame_error_load) }, \
         { "mode", NULL, MAVLINK_TYPE_FLOAT, 0, 20, offsetof(mavlink_esea_sense_in_t, mode) }, \
         { "stop", NULL, MAVLINK_TYPE_FLOAT, 0, 24, offsetof(mavlink_esea_sense_in_t, stop) }, \
         { "rearm", NULL, MAVLINK_TYPE_FLOAT, 0, 28, offsetof(mavlink_esea_sense_in_t, rearm) }, \
         { "tau_desired_Nm", NULL, MAVLINK_TYPE_FLOAT, 0, 32, offsetof(mavlink_esea_sense_in_t, tau_desired_Nm) }, \
         { "theta_desired_rad", NULL, MAVLINK_TYPE_FLOAT, 0, 36, offsetof(mavlink_esea_sense_in_t, theta_desired_rad) }, \
         { "omega_desired_rad_s", NULL, MAVLINK_TYPE_FLOAT, 0, 40, offsetof(mavlink_esea_sense_in_t, omega_desired_rad_s) }, \
         { "count_gear", NULL, MAVLINK_TYPE_FLOAT, 0, 44, offsetof(mavlink_esea_sense_in_t, count_gear) }, \
         { "frame_error_gear", NULL, MAVLINK_TYPE_FLOAT, 0, 48, offsetof(mavlink_esea_sense_in_t, frame_error_gear) }, \
         } \
}
#endif

/**
 * @brief Pack a esea_sense_in message
 * @param system_id ID of this system
 * @param component_id ID of this component (e.g. 200 for IMU)
 * @param msg The MAVLink message to compress the data into
 *
 * @param sequence  Base tick of this run of the task.
 * @param count_motor  raw count as the chip gives it, a whole number; [dimensionless], range 0 to 4095
 * @param frame_error_motor  what is wrong with the frame; 0 when good; [dimensionless], range 0 to 127
 * @param count_load  raw count as the chip gives it, a whole number; [dimensionless], range 0 to 4095
 * @param frame_error_load  what is wrong with the frame; 0 when good; [dimensionless], range 0 to 127
 * @param mode  0 off, 1 torque, 2 impedance (rounded); [dimensionless], range 0 to 2
 * @param stop  0 no, anything else stops; [dimensionless], range 0 to 1
 * @param rearm  whole number, one more for each request; 0 follows 7; [dimensionless], range 0 to 7
 * @param tau_desired_Nm  wanted interaction torque; [Nm], range -20 to 20
 * @param theta_desired_rad [rad] wanted angle of the joint; [rad], range -0.949999988 to 3.3499999
 * @param omega_desired_rad_s [rad/s] wanted rate of the joint; [rad/s], range -12 to 12
 * @param count_gear  raw count of the shaft, a whole number; [dimensionless], range 0 to 131071
 * @param frame_error_gear  what is wrong with the frame; 0 when good; [dimensionless], range 0 to 127
 * @return length of the message in bytes (excluding serial stream start sign)
 */
static inline uint16_t mavlink_msg_esea_sense_in_pack(uint8_t system_id, uint8_t component_id, mavlink_message_t* msg,
                               uint32_t sequence, float count_motor, float frame_error_motor, float count_load, float frame_error_load, float mode, float stop, float rearm, float tau_desired_Nm, float theta_desired_rad, float omega_desired_rad_s, float count_gear, float frame_error_gear)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    char buf[MAVLINK_MSG_ID_ESEA_SENSE_IN_LEN];
    _mav_put_uint32_t(buf, 0, sequence);
    _mav_put_float(buf, 4, count_motor);
    _mav_put_float(buf, 8, frame_error_motor);
    _mav_put_float(buf, 12, count_load);
    _mav_put_float(buf, 16, frame_error_load);
    _mav_put_float(buf, 20, mode);
    _mav_put_float(buf, 24, stop);
    _mav_put_float(buf, 28, rearm);
    _mav_put_float(buf, 32, tau_desired_Nm);
    _mav_put_float(buf, 36, theta_desired_rad);
    _mav_put_float(buf, 40, omega_desired_rad_s);
    _mav_put_float(buf, 44, count_gear);
    _mav_put_float(buf, 48, frame_error_gear);

        memcpy(_MAV_PAYLOAD_NON_CONST(msg), buf, MAVLINK_MSG_ID_ESEA_SENSE_IN_LEN);
#else
    mavlink_esea_sense_in_t packet;
    packet.sequence = sequence;
    packet.count_motor = count_motor;
    packet.frame_error_motor = frame_error_motor;
    packet.count_load = count_load;
    packet.frame_error_load = frame_error_load;
    packet.mode = mode;
    packet.stop = stop;
    packet.rearm = rearm;
    packet.tau_desired_Nm = tau_desired_Nm;
    packet.theta_desired_rad = theta_desired_rad;
    packet.omega_desired_rad_s = omega_desired_rad_s;
    packet.count_gear = count_gear;
    packet.frame_error_gear = frame_error_gear;

        memcpy(_MAV_PAYLOAD_NON_CONST(msg), &packet, MAVLINK_MSG_ID_ESEA_SENSE_IN_LEN);
#endif

    msg->msgid = MAVLINK_MSG_ID_ESEA_SENSE_IN;
    return mavlink_finalize_message(msg, system_id, component_id, MAVLINK_MSG_ID_ESEA_SENSE_IN_MIN_LEN, MAVLINK_MSG_ID_ESEA_SENSE_IN_LEN, MAVLINK_MSG_ID_ESEA_SENSE_IN_CRC);
}

/**
 * @brief Pack a esea_sense_in message
 * @param system_id ID of this system
 * @param component_id ID of this component (e.g. 200 for IMU)
 * @param status MAVLink status structure
 * @param msg The MAVLink message to compress the data into
 *
 * @param sequence  Base tick of this run of the task.
 * @param count_motor  raw count as the chip gives it, a whole number; [dimensionless], range 0 to 4095
 * @param frame_error_motor  what is wrong with the frame; 0 when good; [dimensionless], range 0 to 127
 * @param count_load  raw count as the chip gives it, a whole number; [dimensionless], range 0 to 4095
 * @param frame_error_load  what is wrong with the frame; 0 when good; [dimensionless], range 0 to 127
 * @param mode  0 off, 1 torque, 2 impedance (rounded); [dimensionless], range 0 to 2
 * @param stop  0 no, anything else stops; [dimensionless], range 0 to 1
 * @param rearm  whole number, one more for each request; 0 follows 7; [dimensionless], range 0 to 7
 * @param tau_desired_Nm  wanted interaction torque; [Nm], range -20 to 20
 * @param theta_desired_rad [rad] wanted angle of the joint; [rad], range -0.949999988 to 3.3499999
 * @param omega_desired_rad_s [rad/s] wanted rate of the joint; [rad/s], range -12 to 12
 * @param count_gear  raw count of the shaft, a whole number; [dimensionless], range 0 to 131071
 * @param frame_error_gear  what is wrong with the frame; 0 when good; [dimensionless], range 0 to 127
 * @return length of the message in bytes (excluding serial stream start sign)
 */
static inline uint16_t mavlink_msg_esea_sense_in_pack_status(uint8_t system_id, uint8_t component_id, mavlink_status_t *_status, mavlink_message_t* msg,
                               uint32_t sequence, float count_motor, float frame_error_motor, float count_load, float frame_error_load, float mode, float stop, float rearm, float tau_desired_Nm, float theta_desired_rad, float omega_desired_rad_s, float count_gear, float frame_error_gear)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    char buf[MAVLINK_MSG_ID_ESEA_SENSE_IN_LEN];
    _mav_put_uint32_t(buf, 0, sequence);
    _mav_put_float(buf, 4, count_motor);
    _mav_put_float(buf, 8, frame_error_motor);
    _mav_put_float(buf, 12, count_load);
    _mav_put_float(buf, 16, frame_error_load);
    _mav_put_float(buf, 20, mode);
    _mav_put_float(buf, 24, stop);
    _mav_put_float(buf, 28, rearm);
    _mav_put_float(buf, 32, tau_desired_Nm);
    _mav_put_float(buf, 36, theta_desired_rad);
    _mav_put_float(buf, 40, omega_desired_rad_s);
    _mav_put_float(buf, 44, count_gear);
    _mav_put_float(buf, 48, frame_error_gear);

        memcpy(_MAV_PAYLOAD_NON_CONST(msg), buf, MAVLINK_MSG_ID_ESEA_SENSE_IN_LEN);
#else
    mavlink_esea_sense_in_t packet;
    packet.sequence = sequence;
    packet.count_motor = count_motor;
    packet.frame_error_motor = frame_error_motor;
    packet.count_load = count_load;
    packet.frame_error_load = frame_error_load;
    packet.mode = mode;
    packet.stop = stop;
    packet.rearm = rearm;
    packet.tau_desired_Nm = tau_desired_Nm;
    packet.theta_desired_rad = theta_desired_rad;
    packet.omega_desired_rad_s = omega_desired_rad_s;
    packet.count_gear = count_gear;
    packet.frame_error_gear = frame_error_gear;

        memcpy(_MAV_PAYLOAD_NON_CONST(msg), &packet, MAVLINK_MSG_ID_ESEA_SENSE_IN_LEN);
#endif

    msg->msgid = MAVLINK_MSG_ID_ESEA_SENSE_IN;
#if MAVLINK_CRC_EXTRA
    return mavlink_finalize_message_buffer(msg, system_id, component_id, _status, MAVLINK_MSG_ID_ESEA_SENSE_IN_MIN_LEN, MAVLINK_MSG_ID_ESEA_SENSE_IN_LEN, MAVLINK_MSG_ID_ESEA_SENSE_IN_CRC);
#else
    return mavlink_finalize_message_buffer(msg, system_id, component_id, _status, MAVLINK_MSG_ID_ESEA_SENSE_IN_MIN_LEN, MAVLINK_MSG_ID_ESEA_SENSE_IN_LEN);
#endif
}

/**
 * @brief Pack a esea_sense_in message on a channel
 * @param system_id ID of this system
 * @param component_id ID of this component (e.g. 200 for IMU)
 * @param chan The MAVLink channel this message will be sent over
 * @param msg The MAVLink message to compress the data into
 * @param sequence  Base tick of this run of the task.
 * @param count_motor  raw count as the chip gives it, a whole number; [dimensionless], range 0 to 4095
 * @param frame_error_motor  what is wrong with the frame; 0 when good; [dimensionless], range 0 to 127
 * @param count_load  raw count as the chip gives it, a whole number; [dimensionless], range 0 to 4095
 * @param frame_error_load  what is wrong with the frame; 0 when good; [dimensionless], range 0 to 127
 * @param mode  0 off, 1 torque, 2 impedance (rounded); [dimensionless], range 0 to 2
 * @param stop  0 no, anything else stops; [dimensionless], range 0 to 1
 * @param rearm  whole number, one more for each request; 0 follows 7; [dimensionless], range 0 to 7
 * @param tau_desired_Nm  wanted interaction torque; [Nm], range -20 to 20
 * @param theta_desired_rad [rad] wanted angle of the joint; [rad], range -0.949999988 to 3.3499999
 * @param omega_desired_rad_s [rad/s] wanted rate of the joint; [rad/s], range -12 to 12
 * @param count_gear  raw count of the shaft, a whole number; [dimensionless], range 0 to 131071
 * @param frame_error_gear  what is wrong with the frame; 0 when good; [dimensionless], range 0 to 127
 * @return length of the message in bytes (excluding serial stream start sign)
 */
static inline uint16_t mavlink_msg_esea_sense_in_pack_chan(uint8_t system_id, uint8_t component_id, uint8_t chan,
                               mavlink_message_t* msg,
                                   uint32_t sequence,float count_motor,float frame_error_motor,float count_load,float frame_error_load,float mode,float stop,float rearm,float tau_desired_Nm,float theta_desired_rad,float omega_desired_rad_s,float count_gear,float frame_error_gear)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    char buf[MAVLINK_MSG_ID_ESEA_SENSE_IN_LEN];
    _mav_put_uint32_t(buf, 0, sequence);
    _mav_put_float(buf, 4, count_motor);
    _mav_put_float(buf, 8, frame_error_motor);
    _mav_put_float(buf, 12, count_load);
    _mav_put_float(buf, 16, frame_error_load);
    _mav_put_float(buf, 20, mode);
    _mav_put_float(buf, 24, stop);
    _mav_put_float(buf, 28, rearm);
    _mav_put_float(buf, 32, tau_desired_Nm);
    _mav_put_float(buf, 36, theta_desired_rad);
    _mav_put_float(buf, 40, omega_desired_rad_s);
    _mav_put_float(buf, 44, count_gear);
    _mav_put_float(buf, 48, frame_error_gear);

        memcpy(_MAV_PAYLOAD_NON_CONST(msg), buf, MAVLINK_MSG_ID_ESEA_SENSE_IN_LEN);
#else
    mavlink_esea_sense_in_t packet;
    packet.sequence = sequence;
    packet.count_motor = count_motor;
    packet.frame_error_motor = frame_error_motor;
    packet.count_load = count_load;
    packet.frame_error_load = frame_error_load;
    packet.mode = mode;
    packet.stop = stop;
    packet.rearm = rearm;
    packet.tau_desired_Nm = tau_desired_Nm;
    packet.theta_desired_rad = theta_desired_rad;
    packet.omega_desired_rad_s = omega_desired_rad_s;
    packet.count_gear = count_gear;
    packet.frame_error_gear = frame_error_gear;

        memcpy(_MAV_PAYLOAD_NON_CONST(msg), &packet, MAVLINK_MSG_ID_ESEA_SENSE_IN_LEN);
#endif

    msg->msgid = MAVLINK_MSG_ID_ESEA_SENSE_IN;
    return mavlink_finalize_message_chan(msg, system_id, component_id, chan, MAVLINK_MSG_ID_ESEA_SENSE_IN_MIN_LEN, MAVLINK_MSG_ID_ESEA_SENSE_IN_LEN, MAVLINK_MSG_ID_ESEA_SENSE_IN_CRC);
}

/**
 * @brief Encode a esea_sense_in struct
 *
 * @param system_id ID of this system
 * @param component_id ID of this component (e.g. 200 for IMU)
 * @param msg The MAVLink message to compress the data into
 * @param esea_sense_in C-struct to read the message contents from
 */
static inline uint16_t mavlink_msg_esea_sense_in_encode(uint8_t system_id, uint8_t component_id, mavlink_message_t* msg, const mavlink_esea_sense_in_t* esea_sense_in)
{
    return mavlink_msg_esea_sense_in_pack(system_id, component_id, msg, esea_sense_in->sequence, esea_sense_in->count_motor, esea_sense_in->frame_error_motor, esea_sense_in->count_load, esea_sense_in->frame_error_load, esea_sense_in->mode, esea_sense_in->stop, esea_sense_in->rearm, esea_sense_in->tau_desired_Nm, esea_sense_in->theta_desired_rad, esea_sense_in->omega_desired_rad_s, esea_sense_in->count_gear, esea_sense_in->frame_error_gear);
}

/**
 * @brief Encode a esea_sense_in struct on a channel
 *
 * @param system_id ID of this system
 * @param component_id ID of this component (e.g. 200 for IMU)
 * @param chan The MAVLink channel this message will be sent over
 * @param msg The MAVLink message to compress the data into
 * @param esea_sense_in C-struct to read the message contents from
 */
static inline uint16_t mavlink_msg_esea_sense_in_encode_chan(uint8_t system_id, uint8_t component_id, uint8_t chan, mavlink_message_t* msg, const mavlink_esea_sense_in_t* esea_sense_in)
{
    return mavlink_msg_esea_sense_in_pack_chan(system_id, component_id, chan, msg, esea_sense_in->sequence, esea_sense_in->count_motor, esea_sense_in->frame_error_motor, esea_sense_in->count_load, esea_sense_in->frame_error_load, esea_sense_in->mode, esea_sense_in->stop, esea_sense_in->rearm, esea_sense_in->tau_desired_Nm, esea_sense_in->theta_desired_rad, esea_sense_in->omega_desired_rad_s, esea_sense_in->count_gear, esea_sense_in->frame_error_gear);
}

/**
 * @brief Encode a esea_sense_in struct with provided status structure
 *
 * @param system_id ID of this system
 * @param component_id ID of this component (e.g. 200 for IMU)
 * @param status MAVLink status structure
 * @param msg The MAVLink message to compress the data into
 * @param esea_sense_in C-struct to read the message contents from
 */
static inline uint16_t mavlink_msg_esea_sense_in_encode_status(uint8_t system_id, uint8_t component_id, mavlink_status_t* _status, mavlink_message_t* msg, const mavlink_esea_sense_in_t* esea_sense_in)
{
    return mavlink_msg_esea_sense_in_pack_status(system_id, component_id, _status, msg,  esea_sense_in->sequence, esea_sense_in->count_motor, esea_sense_in->frame_error_motor, esea_sense_in->count_load, esea_sense_in->frame_error_load, esea_sense_in->mode, esea_sense_in->stop, esea_sense_in->rearm, esea_sense_in->tau_desired_Nm, esea_sense_in->theta_desired_rad, esea_sense_in->omega_desired_rad_s, esea_sense_in->count_gear, esea_sense_in->frame_error_gear);
}

/**
 * @brief Send a esea_sense_in message
 * @param chan MAVLink channel to send the message
 *
 * @param sequence  Base tick of this run of the task.
 * @param count_motor  raw count as the chip gives it, a whole number; [dimensionless], range 0 to 4095
 * @param frame_error_motor  what is wrong with the frame; 0 when good; [dimensionless], range 0 to 127
 * @param count_load  raw count as the chip gives it, a whole number; [dimensionless], range 0 to 4095
 * @param frame_error_load  what is wrong with the frame; 0 when good; [dimensionless], range 0 to 127
 * @param mode  0 off, 1 torque, 2 impedance (rounded); [dimensionless], range 0 to 2
 * @param stop  0 no, anything else stops; [dimensionless], range 0 to 1
 * @param rearm  whole number, one more for each request; 0 follows 7; [dimensionless], range 0 to 7
 * @param tau_desired_Nm  wanted interaction torque; [Nm], range -20 to 20
 * @param theta_desired_rad [rad] wanted angle of the joint; [rad], range -0.949999988 to 3.3499999
 * @param omega_desired_rad_s [rad/s] wanted rate of the joint; [rad/s], range -12 to 12
 * @param count_gear  raw count of the shaft, a whole number; [dimensionless], range 0 to 131071
 * @param frame_error_gear  what is wrong with the frame; 0 when good; [dimensionless], range 0 to 127
 */
#ifdef MAVLINK_USE_CONVENIENCE_FUNCTIONS

static inline void mavlink_msg_esea_sense_in_send(mavlink_channel_t chan, uint32_t sequence, float count_motor, float frame_error_motor, float count_load, float frame_error_load, float mode, float stop, float rearm, float tau_desired_Nm, float theta_desired_rad, float omega_desired_rad_s, float count_gear, float frame_error_gear)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    char buf[MAVLINK_MSG_ID_ESEA_SENSE_IN_LEN];
    _mav_put_uint32_t(buf, 0, sequence);
    _mav_put_float(buf, 4, count_motor);
    _mav_put_float(buf, 8, frame_error_motor);
    _mav_put_float(buf, 12, count_load);
    _mav_put_float(buf, 16, frame_error_load);
    _mav_put_float(buf, 20, mode);
    _mav_put_float(buf, 24, stop);
    _mav_put_float(buf, 28, rearm);
    _mav_put_float(buf, 32, tau_desired_Nm);
    _mav_put_float(buf, 36, theta_desired_rad);
    _mav_put_float(buf, 40, omega_desired_rad_s);
    _mav_put_float(buf, 44, count_gear);
    _mav_put_float(buf, 48, frame_error_gear);

    _mav_finalize_message_chan_send(chan, MAVLINK_MSG_ID_ESEA_SENSE_IN, buf, MAVLINK_MSG_ID_ESEA_SENSE_IN_MIN_LEN, MAVLINK_MSG_ID_ESEA_SENSE_IN_LEN, MAVLINK_MSG_ID_ESEA_SENSE_IN_CRC);
#else
    mavlink_esea_sense_in_t packet;
    packet.sequence = sequence;
    packet.count_motor = count_motor;
    packet.frame_error_motor = frame_error_motor;
    packet.count_load = count_load;
    packet.frame_error_load = frame_error_load;
    packet.mode = mode;
    packet.stop = stop;
    packet.rearm = rearm;
    packet.tau_desired_Nm = tau_desired_Nm;
    packet.theta_desired_rad = theta_desired_rad;
    packet.omega_desired_rad_s = omega_desired_rad_s;
    packet.count_gear = count_gear;
    packet.frame_error_gear = frame_error_gear;

    _mav_finalize_message_chan_send(chan, MAVLINK_MSG_ID_ESEA_SENSE_IN, (const char *)&packet, MAVLINK_MSG_ID_ESEA_SENSE_IN_MIN_LEN, MAVLINK_MSG_ID_ESEA_SENSE_IN_LEN, MAVLINK_MSG_ID_ESEA_SENSE_IN_CRC);
#endif
}

/**
 * @brief Send a esea_sense_in message
 * @param chan MAVLink channel to send the message
 * @param struct The MAVLink struct to serialize
 */
static inline void mavlink_msg_esea_sense_in_send_struct(mavlink_channel_t chan, const mavlink_esea_sense_in_t* esea_sense_in)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    mavlink_msg_esea_sense_in_send(chan, esea_sense_in->sequence, esea_sense_in->count_motor, esea_sense_in->frame_error_motor, esea_sense_in->count_load, esea_sense_in->frame_error_load, esea_sense_in->mode, esea_sense_in->stop, esea_sense_in->rearm, esea_sense_in->tau_desired_Nm, esea_sense_in->theta_desired_rad, esea_sense_in->omega_desired_rad_s, esea_sense_in->count_gear, esea_sense_in->frame_error_gear);
#else
    _mav_finalize_message_chan_send(chan, MAVLINK_MSG_ID_ESEA_SENSE_IN, (const char *)esea_sense_in, MAVLINK_MSG_ID_ESEA_SENSE_IN_MIN_LEN, MAVLINK_MSG_ID_ESEA_SENSE_IN_LEN, MAVLINK_MSG_ID_ESEA_SENSE_IN_CRC);
#endif
}

#if MAVLINK_MSG_ID_ESEA_SENSE_IN_LEN <= MAVLINK_MAX_PAYLOAD_LEN
/*
  This variant of _send() can be used to save stack space by reusing
  memory from the receive buffer.  The caller provides a
  mavlink_message_t which is the size of a full mavlink message. This
  is usually the receive buffer for the channel, and allows a reply to an
  incoming message with minimum stack space usage.
 */
static inline void mavlink_msg_esea_sense_in_send_buf(mavlink_message_t *msgbuf, mavlink_channel_t chan,  uint32_t sequence, float count_motor, float frame_error_motor, float count_load, float frame_error_load, float mode, float stop, float rearm, float tau_desired_Nm, float theta_desired_rad, float omega_desired_rad_s, float count_gear, float frame_error_gear)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    char *buf = (char *)msgbuf;
    _mav_put_uint32_t(buf, 0, sequence);
    _mav_put_float(buf, 4, count_motor);
    _mav_put_float(buf, 8, frame_error_motor);
    _mav_put_float(buf, 12, count_load);
    _mav_put_float(buf, 16, frame_error_load);
    _mav_put_float(buf, 20, mode);
    _mav_put_float(buf, 24, stop);
    _mav_put_float(buf, 28, rearm);
    _mav_put_float(buf, 32, tau_desired_Nm);
    _mav_put_float(buf, 36, theta_desired_rad);
    _mav_put_float(buf, 40, omega_desired_rad_s);
    _mav_put_float(buf, 44, count_gear);
    _mav_put_float(buf, 48, frame_error_gear);

    _mav_finalize_message_chan_send(chan, MAVLINK_MSG_ID_ESEA_SENSE_IN, buf, MAVLINK_MSG_ID_ESEA_SENSE_IN_MIN_LEN, MAVLINK_MSG_ID_ESEA_SENSE_IN_LEN, MAVLINK_MSG_ID_ESEA_SENSE_IN_CRC);
#else
    mavlink_esea_sense_in_t *packet = (mavlink_esea_sense_in_t *)msgbuf;
    packet->sequence = sequence;
    packet->count_motor = count_motor;
    packet->frame_error_motor = frame_error_motor;
    packet->count_load = count_load;
    packet->frame_error_load = frame_error_load;
    packet->mode = mode;
    packet->stop = stop;
    packet->rearm = rearm;
    packet->tau_desired_Nm = tau_desired_Nm;
    packet->theta_desired_rad = theta_desired_rad;
    packet->omega_desired_rad_s = omega_desired_rad_s;
    packet->count_gear = count_gear;
    packet->frame_error_gear = frame_error_gear;

    _mav_finalize_message_chan_send(chan, MAVLINK_MSG_ID_ESEA_SENSE_IN, (const char *)packet, MAVLINK_MSG_ID_ESEA_SENSE_IN_MIN_LEN, MAVLINK_MSG_ID_ESEA_SENSE_IN_LEN, MAVLINK_MSG_ID_ESEA_SENSE_IN_CRC);
#endif
}
#endif

#endif

// MESSAGE ESEA_SENSE_IN UNPACKING


/**
 * @brief Get field sequence from esea_sense_in message
 *
 * @return  Base tick of this run of the task.
 */
static inline uint32_t mavlink_msg_esea_sense_in_get_sequence(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint32_t(msg,  0);
}

/**
 * @brief Get field count_motor from esea_sense_in message
 *
 * @return  raw count as the chip gives it, a whole number; [dimensionless], range 0 to 4095
 */
static inline float mavlink_msg_esea_sense_in_get_count_motor(const mavlink_message_t* msg)
{
    return _MAV_RETURN_float(msg,  4);
}

/**
 * @brief Get field frame_error_motor from esea_sense_in message
 *
 * @return  what is wrong with the frame; 0 when good; [dimensionless], range 0 to 127
 */
static inline float mavlink_msg_esea_sense_in_get_frame_error_motor(const mavlink_message_t* msg)
{
    return _MAV_RETURN_float(msg,  8);
}

/**
 * @brief Get field count_load from esea_sense_in message
 *
 * @return  raw count as the chip gives it, a whole number; [dimensionless], range 0 to 4095
 */
static inline float mavlink_msg_esea_sense_in_get_count_load(const mavlink_message_t* msg)
{
    return _MAV_RETURN_float(msg,  12);
}

/**
 * @brief Get field frame_error_load from esea_sense_in message
 *
 * @return  what is wrong with the frame; 0 when good; [dimensionless], range 0 to 127
 */
static inline float mavlink_msg_esea_sense_in_get_frame_error_load(const mavlink_message_t* msg)
{
    return _MAV_RETURN_float(msg,  16);
}

/**
 * @brief Get field mode from esea_sense_in message
 *
 * @return  0 off, 1 torque, 2 impedance (rounded); [dimensionless], range 0 to 2
 */
static inline float mavlink_msg_esea_sense_in_get_mode(const mavlink_message_t* msg)
{
    return _MAV_RETURN_float(msg,  20);
}

/**
 * @brief Get field stop from esea_sense_in message
 *
 * @return  0 no, anything else stops; [dimensionless], range 0 to 1
 */
static inline float mavlink_msg_esea_sense_in_get_stop(const mavlink_message_t* msg)
{
    return _MAV_RETURN_float(msg,  24);
}

/**
 * @brief Get field rearm from esea_sense_in message
 *
 * @return  whole number, one more for each request; 0 follows 7; [dimensionless], range 0 to 7
 */
static inline float mavlink_msg_esea_sense_in_get_rearm(const mavlink_message_t* msg)
{
    return _MAV_RETURN_float(msg,  28);
}

/**
 * @brief Get field tau_desired_Nm from esea_sense_in message
 *
 * @return  wanted interaction torque; [Nm], range -20 to 20
 */
static inline float mavlink_msg_esea_sense_in_get_tau_desired_Nm(const mavlink_message_t* msg)
{
    return _MAV_RETURN_float(msg,  32);
}

/**
 * @brief Get field theta_desired_rad from esea_sense_in message
 *
 * @return [rad] wanted angle of the joint; [rad], range -0.949999988 to 3.3499999
 */
static inline float mavlink_msg_esea_sense_in_get_theta_desired_rad(const mavlink_message_t* msg)
{
    return _MAV_RETURN_float(msg,  36);
}

/**
 * @brief Get field omega_desired_rad_s from esea_sense_in message
 *
 * @return [rad/s] wanted rate of the joint; [rad/s], range -12 to 12
 */
static inline float mavlink_msg_esea_sense_in_get_omega_desired_rad_s(const mavlink_message_t* msg)
{
    return _MAV_RETURN_float(msg,  40);
}

/**
 * @brief Get field count_gear from esea_sense_in message
 *
 * @return  raw count of the shaft, a whole number; [dimensionless], range 0 to 131071
 */
static inline float mavlink_msg_esea_sense_in_get_count_gear(const mavlink_message_t* msg)
{
    return _MAV_RETURN_float(msg,  44);
}

/**
 * @brief Get field frame_error_gear from esea_sense_in message
 *
 * @return  what is wrong with the frame; 0 when good; [dimensionless], range 0 to 127
 */
static inline float mavlink_msg_esea_sense_in_get_frame_error_gear(const mavlink_message_t* msg)
{
    return _MAV_RETURN_float(msg,  48);
}

/**
 * @brief Decode a esea_sense_in message into a struct
 *
 * @param msg The message to decode
 * @param esea_sense_in C-struct to decode the message contents into
 */
static inline void mavlink_msg_esea_sense_in_decode(const mavlink_message_t* msg, mavlink_esea_sense_in_t* esea_sense_in)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    esea_sense_in->sequence = mavlink_msg_esea_sense_in_get_sequence(msg);
    esea_sense_in->count_motor = mavlink_msg_esea_sense_in_get_count_motor(msg);
    esea_sense_in->frame_error_motor = mavlink_msg_esea_sense_in_get_frame_error_motor(msg);
    esea_sense_in->count_load = mavlink_msg_esea_sense_in_get_count_load(msg);
    esea_sense_in->frame_error_load = mavlink_msg_esea_sense_in_get_frame_error_load(msg);
    esea_sense_in->mode = mavlink_msg_esea_sense_in_get_mode(msg);
    esea_sense_in->stop = mavlink_msg_esea_sense_in_get_stop(msg);
    esea_sense_in->rearm = mavlink_msg_esea_sense_in_get_rearm(msg);
    esea_sense_in->tau_desired_Nm = mavlink_msg_esea_sense_in_get_tau_desired_Nm(msg);
    esea_sense_in->theta_desired_rad = mavlink_msg_esea_sense_in_get_theta_desired_rad(msg);
    esea_sense_in->omega_desired_rad_s = mavlink_msg_esea_sense_in_get_omega_desired_rad_s(msg);
    esea_sense_in->count_gear = mavlink_msg_esea_sense_in_get_count_gear(msg);
    esea_sense_in->frame_error_gear = mavlink_msg_esea_sense_in_get_frame_error_gear(msg);
#else
        uint8_t len = msg->len < MAVLINK_MSG_ID_ESEA_SENSE_IN_LEN? msg->len : MAVLINK_MSG_ID_ESEA_SENSE_IN_LEN;
        memset(esea_sense_in, 0, MAVLINK_MSG_ID_ESEA_SENSE_IN_LEN);
    memcpy(esea_sense_in, _MAV_PAYLOAD(msg), len);
#endif
}
