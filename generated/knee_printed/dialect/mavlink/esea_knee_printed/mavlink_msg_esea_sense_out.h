#pragma once
// MESSAGE ESEA_SENSE_OUT PACKING

#include <stdint.h>

#define MAVLINK_MSG_ID_ESEA_SENSE_OUT 42602


typedef struct __mavlink_esea_sense_out_t {
 uint32_t sequence; /*<  Base tick of this run of the task.*/
 float tau_Nm; /*<  interaction torque on the load; [Nm], range -100 to 100; eq. (3.1)*/
 float tau_spring_Nm; /*<  cubic spring: part of the torque on the load; [Nm], range -100 to 100; eq. (3.2)*/
 float tau_rate_Nm; /*<  Maxwell element: part of the torque on the load; [Nm], range -100 to 100; eq. (3.3)*/
 float tau_hysteresis_Nm; /*<  stop operators: part of the torque on the load; [Nm], range -100 to 100; eq. (3.9)*/
 float omega_rad_s; /*< [rad/s] deflection rate at this sample; [rad/s], range -25 to 25*/
 uint32_t sensor_status; /*<  what is known of this sample; bits below*/
 uint32_t velocity_status; /*<  what is known of this sample; bits below*/
 uint32_t smoothing_status; /*<  what is known of this sample; bits below*/
 uint32_t step_ticks; /*<  Timer ticks of the step, measuring included (empty_ticks).*/
} mavlink_esea_sense_out_t;

#define MAVLINK_MSG_ID_ESEA_SENSE_OUT_LEN 40
#define MAVLINK_MSG_ID_ESEA_SENSE_OUT_MIN_LEN 40
#define MAVLINK_MSG_ID_42602_LEN 40
#define MAVLINK_MSG_ID_42602_MIN_LEN 40

#define MAVLINK_MSG_ID_ESEA_SENSE_OUT_CRC 129
#define MAVLINK_MSG_ID_42602_CRC 129



#if MAVLINK_COMMAND_24BIT
#define MAVLINK_MESSAGE_INFO_ESEA_SENSE_OUT { \
    42602, \
    "ESEA_SENSE_OUT", \
    10, \
    {  { "sequence", NULL, MAVLINK_TYPE_UINT32_T, 0, 0, offsetof(mavlink_esea_sense_out_t, sequence) }, \
         { "tau_Nm", NULL, MAVLINK_TYPE_FLOAT, 0, 4, offsetof(mavlink_esea_sense_out_t, tau_Nm) }, \
         { "tau_spring_Nm", NULL, MAVLINK_TYPE_FLOAT, 0, 8, offsetof(mavlink_esea_sense_out_t, tau_spring_Nm) }, \
         { "tau_rate_Nm", NULL, MAVLINK_TYPE_FLOAT, 0, 12, offsetof(mavlink_esea_sense_out_t, tau_rate_Nm) }, \
         { "tau_hysteresis_Nm", NULL, MAVLINK_TYPE_FLOAT, 0, 16, offsetof(mavlink_esea_sense_out_t, tau_hysteresis_Nm) }, \
         { "omega_rad_s", NULL, MAVLINK_TYPE_FLOAT, 0, 20, offsetof(mavlink_esea_sense_out_t, omega_rad_s) }, \
         { "sensor_status", NULL, MAVLINK_TYPE_UINT32_T, 0, 24, offsetof(mavlink_esea_sense_out_t, sensor_status) }, \
         { "velocity_status", NULL, MAVLINK_TYPE_UINT32_T, 0, 28, offsetof(mavlink_esea_sense_out_t, velocity_status) }, \
         { "smoothing_status", NULL, MAVLINK_TYPE_UINT32_T, 0, 32, offsetof(mavlink_esea_sense_out_t, smoothing_status) }, \
         { "step_ticks", NULL, MAVLINK_TYPE_UINT32_T, 0, 36, offsetof(mavlink_esea_sense_out_t, step_ticks) }, \
         } \
}
#else
#define MAVLINK_MESSAGE_INFO_ESEA_SENSE_OUT { \
    "ESEA_SENSE_OUT", \
    10, \
    {  { "sequence", NULL, MAVLINK_TYPE_UINT32_T, 0, 0, offsetof(mavlink_esea_sense_out_t, sequence) }, \
         { "tau_Nm", NULL, MAVLINK_TYPE_FLOAT, 0, 4, offsetof(mavlink_esea_sense_out_t, tau_Nm) }, \
         { "tau_spring_Nm", NULL, MAVLINK_TYPE_FLOAT, 0, 8, offsetof(mavlink_esea_sense_out_t, tau_spring_Nm) }, \
         { "tau_rate_Nm", NULL, MAVLINK_TYPE_FLOAT, 0, 12, offsetof(mavlink_esea_sense_out_t, tau_rate_Nm) }, \
         { "tau_hysteresis_Nm", NULL, MAVLINK_TYPE_FLOAT, 0, 16, offsetof(mavlink_esea_sense_out_t, tau_hysteresis_Nm) }, \
         { "omega_rad_s", NULL, MAVLINK_TYPE_FLOAT, 0, 20, offsetof(mavlink_esea_sense_out_t, omega_rad_s) }, \
         { "sensor_status", NULL, MAVLINK_TYPE_UINT32_T, 0, 24, offsetof(mavlink_esea_sense_out_t, sensor_status) }, \
         { "velocity_status", NULL, MAVLINK_TYPE_UINT32_T, 0, 28, offsetof(mavlink_esea_sense_out_t, velocity_status) }, \
         { "smoothing_status", NULL, MAVLINK_TYPE_UINT32_T, 0, 32, offsetof(mavlink_esea_sense_out_t, smoothing_status) }, \
         { "step_ticks", NULL, MAVLINK_TYPE_UINT32_T, 0, 36, offsetof(mavlink_esea_sense_out_t, step_ticks) }, \
         } \
}
#endif

/**
 * @brief Pack a esea_sense_out message
 * @param system_id ID of this system
 * @param component_id ID of this component (e.g. 200 for IMU)
 * @param msg The MAVLink message to compress the data into
 *
 * @param sequence  Base tick of this run of the task.
 * @param tau_Nm  interaction torque on the load; [Nm], range -100 to 100; eq. (3.1)
 * @param tau_spring_Nm  cubic spring: part of the torque on the load; [Nm], range -100 to 100; eq. (3.2)
 * @param tau_rate_Nm  Maxwell element: part of the torque on the load; [Nm], range -100 to 100; eq. (3.3)
 * @param tau_hysteresis_Nm  stop operators: part of the torque on the load; [Nm], range -100 to 100; eq. (3.9)
 * @param omega_rad_s [rad/s] deflection rate at this sample; [rad/s], range -25 to 25
 * @param sensor_status  what is known of this sample; bits below
 * @param velocity_status  what is known of this sample; bits below
 * @param smoothing_status  what is known of this sample; bits below
 * @param step_ticks  Timer ticks of the step, measuring included (empty_ticks).
 * @return length of the message in bytes (excluding serial stream start sign)
 */
static inline uint16_t mavlink_msg_esea_sense_out_pack(uint8_t system_id, uint8_t component_id, mavlink_message_t* msg,
                               uint32_t sequence, float tau_Nm, float tau_spring_Nm, float tau_rate_Nm, float tau_hysteresis_Nm, float omega_rad_s, uint32_t sensor_status, uint32_t velocity_status, uint32_t smoothing_status, uint32_t step_ticks)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    char buf[MAVLINK_MSG_ID_ESEA_SENSE_OUT_LEN];
    _mav_put_uint32_t(buf, 0, sequence);
    _mav_put_float(buf, 4, tau_Nm);
    _mav_put_float(buf, 8, tau_spring_Nm);
    _mav_put_float(buf, 12, tau_rate_Nm);
    _mav_put_float(buf, 16, tau_hysteresis_Nm);
    _mav_put_float(buf, 20, omega_rad_s);
    _mav_put_uint32_t(buf, 24, sensor_status);
    _mav_put_uint32_t(buf, 28, velocity_status);
    _mav_put_uint32_t(buf, 32, smoothing_status);
    _mav_put_uint32_t(buf, 36, step_ticks);

        memcpy(_MAV_PAYLOAD_NON_CONST(msg), buf, MAVLINK_MSG_ID_ESEA_SENSE_OUT_LEN);
#else
    mavlink_esea_sense_out_t packet;
    packet.sequence = sequence;
    packet.tau_Nm = tau_Nm;
    packet.tau_spring_Nm = tau_spring_Nm;
    packet.tau_rate_Nm = tau_rate_Nm;
    packet.tau_hysteresis_Nm = tau_hysteresis_Nm;
    packet.omega_rad_s = omega_rad_s;
    packet.sensor_status = sensor_status;
    packet.velocity_status = velocity_status;
    packet.smoothing_status = smoothing_status;
    packet.step_ticks = step_ticks;

        memcpy(_MAV_PAYLOAD_NON_CONST(msg), &packet, MAVLINK_MSG_ID_ESEA_SENSE_OUT_LEN);
#endif

    msg->msgid = MAVLINK_MSG_ID_ESEA_SENSE_OUT;
    return mavlink_finalize_message(msg, system_id, component_id, MAVLINK_MSG_ID_ESEA_SENSE_OUT_MIN_LEN, MAVLINK_MSG_ID_ESEA_SENSE_OUT_LEN, MAVLINK_MSG_ID_ESEA_SENSE_OUT_CRC);
}

/**
 * @brief Pack a esea_sense_out message
 * @param system_id ID of this system
 * @param component_id ID of this component (e.g. 200 for IMU)
 * @param status MAVLink status structure
 * @param msg The MAVLink message to compress the data into
 *
 * @param sequence  Base tick of this run of the task.
 * @param tau_Nm  interaction torque on the load; [Nm], range -100 to 100; eq. (3.1)
 * @param tau_spring_Nm  cubic spring: part of the torque on the load; [Nm], range -100 to 100; eq. (3.2)
 * @param tau_rate_Nm  Maxwell element: part of the torque on the load; [Nm], range -100 to 100; eq. (3.3)
 * @param tau_hysteresis_Nm  stop operators: part of the torque on the load; [Nm], range -100 to 100; eq. (3.9)
 * @param omega_rad_s [rad/s] deflection rate at this sample; [rad/s], range -25 to 25
 * @param sensor_status  what is known of this sample; bits below
 * @param velocity_status  what is known of this sample; bits below
 * @param smoothing_status  what is known of this sample; bits below
 * @param step_ticks  Timer ticks of the step, measuring included (empty_ticks).
 * @return length of the message in bytes (excluding serial stream start sign)
 */
static inline uint16_t mavlink_msg_esea_sense_out_pack_status(uint8_t system_id, uint8_t component_id, mavlink_status_t *_status, mavlink_message_t* msg,
                               uint32_t sequence, float tau_Nm, float tau_spring_Nm, float tau_rate_Nm, float tau_hysteresis_Nm, float omega_rad_s, uint32_t sensor_status, uint32_t velocity_status, uint32_t smoothing_status, uint32_t step_ticks)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    char buf[MAVLINK_MSG_ID_ESEA_SENSE_OUT_LEN];
    _mav_put_uint32_t(buf, 0, sequence);
    _mav_put_float(buf, 4, tau_Nm);
    _mav_put_float(buf, 8, tau_spring_Nm);
    _mav_put_float(buf, 12, tau_rate_Nm);
    _mav_put_float(buf, 16, tau_hysteresis_Nm);
    _mav_put_float(buf, 20, omega_rad_s);
    _mav_put_uint32_t(buf, 24, sensor_status);
    _mav_put_uint32_t(buf, 28, velocity_status);
    _mav_put_uint32_t(buf, 32, smoothing_status);
    _mav_put_uint32_t(buf, 36, step_ticks);

        memcpy(_MAV_PAYLOAD_NON_CONST(msg), buf, MAVLINK_MSG_ID_ESEA_SENSE_OUT_LEN);
#else
    mavlink_esea_sense_out_t packet;
    packet.sequence = sequence;
    packet.tau_Nm = tau_Nm;
    packet.tau_spring_Nm = tau_spring_Nm;
    packet.tau_rate_Nm = tau_rate_Nm;
    packet.tau_hysteresis_Nm = tau_hysteresis_Nm;
    packet.omega_rad_s = omega_rad_s;
    packet.sensor_status = sensor_status;
    packet.velocity_status = velocity_status;
    packet.smoothing_status = smoothing_status;
    packet.step_ticks = step_ticks;

        memcpy(_MAV_PAYLOAD_NON_CONST(msg), &packet, MAVLINK_MSG_ID_ESEA_SENSE_OUT_LEN);
#endif

    msg->msgid = MAVLINK_MSG_ID_ESEA_SENSE_OUT;
#if MAVLINK_CRC_EXTRA
    return mavlink_finalize_message_buffer(msg, system_id, component_id, _status, MAVLINK_MSG_ID_ESEA_SENSE_OUT_MIN_LEN, MAVLINK_MSG_ID_ESEA_SENSE_OUT_LEN, MAVLINK_MSG_ID_ESEA_SENSE_OUT_CRC);
#else
    return mavlink_finalize_message_buffer(msg, system_id, component_id, _status, MAVLINK_MSG_ID_ESEA_SENSE_OUT_MIN_LEN, MAVLINK_MSG_ID_ESEA_SENSE_OUT_LEN);
#endif
}

/**
 * @brief Pack a esea_sense_out message on a channel
 * @param system_id ID of this system
 * @param component_id ID of this component (e.g. 200 for IMU)
 * @param chan The MAVLink channel this message will be sent over
 * @param msg The MAVLink message to compress the data into
 * @param sequence  Base tick of this run of the task.
 * @param tau_Nm  interaction torque on the load; [Nm], range -100 to 100; eq. (3.1)
 * @param tau_spring_Nm  cubic spring: part of the torque on the load; [Nm], range -100 to 100; eq. (3.2)
 * @param tau_rate_Nm  Maxwell element: part of the torque on the load; [Nm], range -100 to 100; eq. (3.3)
 * @param tau_hysteresis_Nm  stop operators: part of the torque on the load; [Nm], range -100 to 100; eq. (3.9)
 * @param omega_rad_s [rad/s] deflection rate at this sample; [rad/s], range -25 to 25
 * @param sensor_status  what is known of this sample; bits below
 * @param velocity_status  what is known of this sample; bits below
 * @param smoothing_status  what is known of this sample; bits below
 * @param step_ticks  Timer ticks of the step, measuring included (empty_ticks).
 * @return length of the message in bytes (excluding serial stream start sign)
 */
static inline uint16_t mavlink_msg_esea_sense_out_pack_chan(uint8_t system_id, uint8_t component_id, uint8_t chan,
                               mavlink_message_t* msg,
                                   uint32_t sequence,float tau_Nm,float tau_spring_Nm,float tau_rate_Nm,float tau_hysteresis_Nm,float omega_rad_s,uint32_t sensor_status,uint32_t velocity_status,uint32_t smoothing_status,uint32_t step_ticks)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    char buf[MAVLINK_MSG_ID_ESEA_SENSE_OUT_LEN];
    _mav_put_uint32_t(buf, 0, sequence);
    _mav_put_float(buf, 4, tau_Nm);
    _mav_put_float(buf, 8, tau_spring_Nm);
    _mav_put_float(buf, 12, tau_rate_Nm);
    _mav_put_float(buf, 16, tau_hysteresis_Nm);
    _mav_put_float(buf, 20, omega_rad_s);
    _mav_put_uint32_t(buf, 24, sensor_status);
    _mav_put_uint32_t(buf, 28, velocity_status);
    _mav_put_uint32_t(buf, 32, smoothing_status);
    _mav_put_uint32_t(buf, 36, step_ticks);

        memcpy(_MAV_PAYLOAD_NON_CONST(msg), buf, MAVLINK_MSG_ID_ESEA_SENSE_OUT_LEN);
#else
    mavlink_esea_sense_out_t packet;
    packet.sequence = sequence;
    packet.tau_Nm = tau_Nm;
    packet.tau_spring_Nm = tau_spring_Nm;
    packet.tau_rate_Nm = tau_rate_Nm;
    packet.tau_hysteresis_Nm = tau_hysteresis_Nm;
    packet.omega_rad_s = omega_rad_s;
    packet.sensor_status = sensor_status;
    packet.velocity_status = velocity_status;
    packet.smoothing_status = smoothing_status;
    packet.step_ticks = step_ticks;

        memcpy(_MAV_PAYLOAD_NON_CONST(msg), &packet, MAVLINK_MSG_ID_ESEA_SENSE_OUT_LEN);
#endif

    msg->msgid = MAVLINK_MSG_ID_ESEA_SENSE_OUT;
    return mavlink_finalize_message_chan(msg, system_id, component_id, chan, MAVLINK_MSG_ID_ESEA_SENSE_OUT_MIN_LEN, MAVLINK_MSG_ID_ESEA_SENSE_OUT_LEN, MAVLINK_MSG_ID_ESEA_SENSE_OUT_CRC);
}

/**
 * @brief Encode a esea_sense_out struct
 *
 * @param system_id ID of this system
 * @param component_id ID of this component (e.g. 200 for IMU)
 * @param msg The MAVLink message to compress the data into
 * @param esea_sense_out C-struct to read the message contents from
 */
static inline uint16_t mavlink_msg_esea_sense_out_encode(uint8_t system_id, uint8_t component_id, mavlink_message_t* msg, const mavlink_esea_sense_out_t* esea_sense_out)
{
    return mavlink_msg_esea_sense_out_pack(system_id, component_id, msg, esea_sense_out->sequence, esea_sense_out->tau_Nm, esea_sense_out->tau_spring_Nm, esea_sense_out->tau_rate_Nm, esea_sense_out->tau_hysteresis_Nm, esea_sense_out->omega_rad_s, esea_sense_out->sensor_status, esea_sense_out->velocity_status, esea_sense_out->smoothing_status, esea_sense_out->step_ticks);
}

/**
 * @brief Encode a esea_sense_out struct on a channel
 *
 * @param system_id ID of this system
 * @param component_id ID of this component (e.g. 200 for IMU)
 * @param chan The MAVLink channel this message will be sent over
 * @param msg The MAVLink message to compress the data into
 * @param esea_sense_out C-struct to read the message contents from
 */
static inline uint16_t mavlink_msg_esea_sense_out_encode_chan(uint8_t system_id, uint8_t component_id, uint8_t chan, mavlink_message_t* msg, const mavlink_esea_sense_out_t* esea_sense_out)
{
    return mavlink_msg_esea_sense_out_pack_chan(system_id, component_id, chan, msg, esea_sense_out->sequence, esea_sense_out->tau_Nm, esea_sense_out->tau_spring_Nm, esea_sense_out->tau_rate_Nm, esea_sense_out->tau_hysteresis_Nm, esea_sense_out->omega_rad_s, esea_sense_out->sensor_status, esea_sense_out->velocity_status, esea_sense_out->smoothing_status, esea_sense_out->step_ticks);
}

/**
 * @brief Encode a esea_sense_out struct with provided status structure
 *
 * @param system_id ID of this system
 * @param component_id ID of this component (e.g. 200 for IMU)
 * @param status MAVLink status structure
 * @param msg The MAVLink message to compress the data into
 * @param esea_sense_out C-struct to read the message contents from
 */
static inline uint16_t mavlink_msg_esea_sense_out_encode_status(uint8_t system_id, uint8_t component_id, mavlink_status_t* _status, mavlink_message_t* msg, const mavlink_esea_sense_out_t* esea_sense_out)
{
    return mavlink_msg_esea_sense_out_pack_status(system_id, component_id, _status, msg,  esea_sense_out->sequence, esea_sense_out->tau_Nm, esea_sense_out->tau_spring_Nm, esea_sense_out->tau_rate_Nm, esea_sense_out->tau_hysteresis_Nm, esea_sense_out->omega_rad_s, esea_sense_out->sensor_status, esea_sense_out->velocity_status, esea_sense_out->smoothing_status, esea_sense_out->step_ticks);
}

/**
 * @brief Send a esea_sense_out message
 * @param chan MAVLink channel to send the message
 *
 * @param sequence  Base tick of this run of the task.
 * @param tau_Nm  interaction torque on the load; [Nm], range -100 to 100; eq. (3.1)
 * @param tau_spring_Nm  cubic spring: part of the torque on the load; [Nm], range -100 to 100; eq. (3.2)
 * @param tau_rate_Nm  Maxwell element: part of the torque on the load; [Nm], range -100 to 100; eq. (3.3)
 * @param tau_hysteresis_Nm  stop operators: part of the torque on the load; [Nm], range -100 to 100; eq. (3.9)
 * @param omega_rad_s [rad/s] deflection rate at this sample; [rad/s], range -25 to 25
 * @param sensor_status  what is known of this sample; bits below
 * @param velocity_status  what is known of this sample; bits below
 * @param smoothing_status  what is known of this sample; bits below
 * @param step_ticks  Timer ticks of the step, measuring included (empty_ticks).
 */
#ifdef MAVLINK_USE_CONVENIENCE_FUNCTIONS

static inline void mavlink_msg_esea_sense_out_send(mavlink_channel_t chan, uint32_t sequence, float tau_Nm, float tau_spring_Nm, float tau_rate_Nm, float tau_hysteresis_Nm, float omega_rad_s, uint32_t sensor_status, uint32_t velocity_status, uint32_t smoothing_status, uint32_t step_ticks)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    char buf[MAVLINK_MSG_ID_ESEA_SENSE_OUT_LEN];
    _mav_put_uint32_t(buf, 0, sequence);
    _mav_put_float(buf, 4, tau_Nm);
    _mav_put_float(buf, 8, tau_spring_Nm);
    _mav_put_float(buf, 12, tau_rate_Nm);
    _mav_put_float(buf, 16, tau_hysteresis_Nm);
    _mav_put_float(buf, 20, omega_rad_s);
    _mav_put_uint32_t(buf, 24, sensor_status);
    _mav_put_uint32_t(buf, 28, velocity_status);
    _mav_put_uint32_t(buf, 32, smoothing_status);
    _mav_put_uint32_t(buf, 36, step_ticks);

    _mav_finalize_message_chan_send(chan, MAVLINK_MSG_ID_ESEA_SENSE_OUT, buf, MAVLINK_MSG_ID_ESEA_SENSE_OUT_MIN_LEN, MAVLINK_MSG_ID_ESEA_SENSE_OUT_LEN, MAVLINK_MSG_ID_ESEA_SENSE_OUT_CRC);
#else
    mavlink_esea_sense_out_t packet;
    packet.sequence = sequence;
    packet.tau_Nm = tau_Nm;
    packet.tau_spring_Nm = tau_spring_Nm;
    packet.tau_rate_Nm = tau_rate_Nm;
    packet.tau_hysteresis_Nm = tau_hysteresis_Nm;
    packet.omega_rad_s = omega_rad_s;
    packet.sensor_status = sensor_status;
    packet.velocity_status = velocity_status;
    packet.smoothing_status = smoothing_status;
    packet.step_ticks = step_ticks;

    _mav_finalize_message_chan_send(chan, MAVLINK_MSG_ID_ESEA_SENSE_OUT, (const char *)&packet, MAVLINK_MSG_ID_ESEA_SENSE_OUT_MIN_LEN, MAVLINK_MSG_ID_ESEA_SENSE_OUT_LEN, MAVLINK_MSG_ID_ESEA_SENSE_OUT_CRC);
#endif
}

/**
 * @brief Send a esea_sense_out message
 * @param chan MAVLink channel to send the message
 * @param struct The MAVLink struct to serialize
 */
static inline void mavlink_msg_esea_sense_out_send_struct(mavlink_channel_t chan, const mavlink_esea_sense_out_t* esea_sense_out)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    mavlink_msg_esea_sense_out_send(chan, esea_sense_out->sequence, esea_sense_out->tau_Nm, esea_sense_out->tau_spring_Nm, esea_sense_out->tau_rate_Nm, esea_sense_out->tau_hysteresis_Nm, esea_sense_out->omega_rad_s, esea_sense_out->sensor_status, esea_sense_out->velocity_status, esea_sense_out->smoothing_status, esea_sense_out->step_ticks);
#else
    _mav_finalize_message_chan_send(chan, MAVLINK_MSG_ID_ESEA_SENSE_OUT, (const char *)esea_sense_out, MAVLINK_MSG_ID_ESEA_SENSE_OUT_MIN_LEN, MAVLINK_MSG_ID_ESEA_SENSE_OUT_LEN, MAVLINK_MSG_ID_ESEA_SENSE_OUT_CRC);
#endif
}

#if MAVLINK_MSG_ID_ESEA_SENSE_OUT_LEN <= MAVLINK_MAX_PAYLOAD_LEN
/*
  This variant of _send() can be used to save stack space by reusing
  memory from the receive buffer.  The caller provides a
  mavlink_message_t which is the size of a full mavlink message. This
  is usually the receive buffer for the channel, and allows a reply to an
  incoming message with minimum stack space usage.
 */
static inline void mavlink_msg_esea_sense_out_send_buf(mavlink_message_t *msgbuf, mavlink_channel_t chan,  uint32_t sequence, float tau_Nm, float tau_spring_Nm, float tau_rate_Nm, float tau_hysteresis_Nm, float omega_rad_s, uint32_t sensor_status, uint32_t velocity_status, uint32_t smoothing_status, uint32_t step_ticks)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    char *buf = (char *)msgbuf;
    _mav_put_uint32_t(buf, 0, sequence);
    _mav_put_float(buf, 4, tau_Nm);
    _mav_put_float(buf, 8, tau_spring_Nm);
    _mav_put_float(buf, 12, tau_rate_Nm);
    _mav_put_float(buf, 16, tau_hysteresis_Nm);
    _mav_put_float(buf, 20, omega_rad_s);
    _mav_put_uint32_t(buf, 24, sensor_status);
    _mav_put_uint32_t(buf, 28, velocity_status);
    _mav_put_uint32_t(buf, 32, smoothing_status);
    _mav_put_uint32_t(buf, 36, step_ticks);

    _mav_finalize_message_chan_send(chan, MAVLINK_MSG_ID_ESEA_SENSE_OUT, buf, MAVLINK_MSG_ID_ESEA_SENSE_OUT_MIN_LEN, MAVLINK_MSG_ID_ESEA_SENSE_OUT_LEN, MAVLINK_MSG_ID_ESEA_SENSE_OUT_CRC);
#else
    mavlink_esea_sense_out_t *packet = (mavlink_esea_sense_out_t *)msgbuf;
    packet->sequence = sequence;
    packet->tau_Nm = tau_Nm;
    packet->tau_spring_Nm = tau_spring_Nm;
    packet->tau_rate_Nm = tau_rate_Nm;
    packet->tau_hysteresis_Nm = tau_hysteresis_Nm;
    packet->omega_rad_s = omega_rad_s;
    packet->sensor_status = sensor_status;
    packet->velocity_status = velocity_status;
    packet->smoothing_status = smoothing_status;
    packet->step_ticks = step_ticks;

    _mav_finalize_message_chan_send(chan, MAVLINK_MSG_ID_ESEA_SENSE_OUT, (const char *)packet, MAVLINK_MSG_ID_ESEA_SENSE_OUT_MIN_LEN, MAVLINK_MSG_ID_ESEA_SENSE_OUT_LEN, MAVLINK_MSG_ID_ESEA_SENSE_OUT_CRC);
#endif
}
#endif

#endif

// MESSAGE ESEA_SENSE_OUT UNPACKING


/**
 * @brief Get field sequence from esea_sense_out message
 *
 * @return  Base tick of this run of the task.
 */
static inline uint32_t mavlink_msg_esea_sense_out_get_sequence(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint32_t(msg,  0);
}

/**
 * @brief Get field tau_Nm from esea_sense_out message
 *
 * @return  interaction torque on the load; [Nm], range -100 to 100; eq. (3.1)
 */
static inline float mavlink_msg_esea_sense_out_get_tau_Nm(const mavlink_message_t* msg)
{
    return _MAV_RETURN_float(msg,  4);
}

/**
 * @brief Get field tau_spring_Nm from esea_sense_out message
 *
 * @return  cubic spring: part of the torque on the load; [Nm], range -100 to 100; eq. (3.2)
 */
static inline float mavlink_msg_esea_sense_out_get_tau_spring_Nm(const mavlink_message_t* msg)
{
    return _MAV_RETURN_float(msg,  8);
}

/**
 * @brief Get field tau_rate_Nm from esea_sense_out message
 *
 * @return  Maxwell element: part of the torque on the load; [Nm], range -100 to 100; eq. (3.3)
 */
static inline float mavlink_msg_esea_sense_out_get_tau_rate_Nm(const mavlink_message_t* msg)
{
    return _MAV_RETURN_float(msg,  12);
}

/**
 * @brief Get field tau_hysteresis_Nm from esea_sense_out message
 *
 * @return  stop operators: part of the torque on the load; [Nm], range -100 to 100; eq. (3.9)
 */
static inline float mavlink_msg_esea_sense_out_get_tau_hysteresis_Nm(const mavlink_message_t* msg)
{
    return _MAV_RETURN_float(msg,  16);
}

/**
 * @brief Get field omega_rad_s from esea_sense_out message
 *
 * @return [rad/s] deflection rate at this sample; [rad/s], range -25 to 25
 */
static inline float mavlink_msg_esea_sense_out_get_omega_rad_s(const mavlink_message_t* msg)
{
    return _MAV_RETURN_float(msg,  20);
}

/**
 * @brief Get field sensor_status from esea_sense_out message
 *
 * @return  what is known of this sample; bits below
 */
static inline uint32_t mavlink_msg_esea_sense_out_get_sensor_status(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint32_t(msg,  24);
}

/**
 * @brief Get field velocity_status from esea_sense_out message
 *
 * @return  what is known of this sample; bits below
 */
static inline uint32_t mavlink_msg_esea_sense_out_get_velocity_status(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint32_t(msg,  28);
}

/**
 * @brief Get field smoothing_status from esea_sense_out message
 *
 * @return  what is known of this sample; bits below
 */
static inline uint32_t mavlink_msg_esea_sense_out_get_smoothing_status(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint32_t(msg,  32);
}

/**
 * @brief Get field step_ticks from esea_sense_out message
 *
 * @return  Timer ticks of the step, measuring included (empty_ticks).
 */
static inline uint32_t mavlink_msg_esea_sense_out_get_step_ticks(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint32_t(msg,  36);
}

/**
 * @brief Decode a esea_sense_out message into a struct
 *
 * @param msg The message to decode
 * @param esea_sense_out C-struct to decode the message contents into
 */
static inline void mavlink_msg_esea_sense_out_decode(const mavlink_message_t* msg, mavlink_esea_sense_out_t* esea_sense_out)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    esea_sense_out->sequence = mavlink_msg_esea_sense_out_get_sequence(msg);
    esea_sense_out->tau_Nm = mavlink_msg_esea_sense_out_get_tau_Nm(msg);
    esea_sense_out->tau_spring_Nm = mavlink_msg_esea_sense_out_get_tau_spring_Nm(msg);
    esea_sense_out->tau_rate_Nm = mavlink_msg_esea_sense_out_get_tau_rate_Nm(msg);
    esea_sense_out->tau_hysteresis_Nm = mavlink_msg_esea_sense_out_get_tau_hysteresis_Nm(msg);
    esea_sense_out->omega_rad_s = mavlink_msg_esea_sense_out_get_omega_rad_s(msg);
    esea_sense_out->sensor_status = mavlink_msg_esea_sense_out_get_sensor_status(msg);
    esea_sense_out->velocity_status = mavlink_msg_esea_sense_out_get_velocity_status(msg);
    esea_sense_out->smoothing_status = mavlink_msg_esea_sense_out_get_smoothing_status(msg);
    esea_sense_out->step_ticks = mavlink_msg_esea_sense_out_get_step_ticks(msg);
#else
        uint8_t len = msg->len < MAVLINK_MSG_ID_ESEA_SENSE_OUT_LEN? msg->len : MAVLINK_MSG_ID_ESEA_SENSE_OUT_LEN;
        memset(esea_sense_out, 0, MAVLINK_MSG_ID_ESEA_SENSE_OUT_LEN);
    memcpy(esea_sense_out, _MAV_PAYLOAD(msg), len);
#endif
}
