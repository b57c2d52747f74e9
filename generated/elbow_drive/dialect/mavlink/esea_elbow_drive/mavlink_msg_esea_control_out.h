#pragma once
// MESSAGE ESEA_CONTROL_OUT PACKING

#include <stdint.h>

#define MAVLINK_MSG_ID_ESEA_CONTROL_OUT 42604


typedef struct __mavlink_esea_control_out_t {
 uint32_t sequence; /*<  Base tick of this run of the task.*/
 float u_command_Nm; /*<  command at the motor shaft; [Nm], range -0.220999986 to 0.220999986; eq. (5.22)*/
 float apart_rad; /*< [rad] drive's angle less the motor side's; [rad], range -15.8091927 to 15.8091927*/
 float apart_Nm; /*<  torque at the drive that nothing explains; [Nm], range -16.3703518 to 16.3703518*/
 float room_Nm; /*<  how large that may be now; [Nm], range 0 to 30.1256943*/
 float surface_rad_s; /*< [rad/s] surface; [rad/s], range -168.167984 to 168.167984; eq. (5.12)*/
 float u_eq_Nm; /*<  equivalent control; [Nm], range -29.0375538 to 29.0375538; eq. (5.16)*/
 float k_smc_Nm; /*<  switching gain; [Nm], range 0 to 10.9715872; eq. (5.20)*/
 uint32_t set_trend_status; /*<  what is known of it; bits below*/
 uint32_t smc_status; /*<  what is known of this command; bits below*/
 uint32_t redundancy_status; /*<  what is known of this sample; bits below*/
 uint32_t stamp_status; /*<  what is known of this command; bits below*/
 uint32_t step_ticks; /*<  Timer ticks of the step, measuring included (empty_ticks).*/
} mavlink_esea_control_out_t;

#define MAVLINK_MSG_ID_ESEA_CONTROL_OUT_LEN 52
#define MAVLINK_MSG_ID_ESEA_CONTROL_OUT_MIN_LEN 52
#define MAVLINK_MSG_ID_42604_LEN 52
#define MAVLINK_MSG_ID_42604_MIN_LEN 52

#define MAVLINK_MSG_ID_ESEA_CONTROL_OUT_CRC 41
#define MAVLINK_MSG_ID_42604_CRC 41



#if MAVLINK_COMMAND_24BIT
#define MAVLINK_MESSAGE_INFO_ESEA_CONTROL_OUT { \
    42604, \
    "ESEA_CONTROL_OUT", \
    13, \
    {  { "sequence", NULL, MAVLINK_TYPE_UINT32_T, 0, 0, offsetof(mavlink_esea_control_out_t, sequence) }, \
         { "u_command_Nm", NULL, MAVLINK_TYPE_FLOAT, 0, 4, offsetof(mavlink_esea_control_out_t, u_command_Nm) }, \
         { "apart_rad", NULL, MAVLINK_TYPE_FLOAT, 0, 8, offsetof(mavlink_esea_control_out_t, apart_rad) }, \
         { "apart_Nm", NULL, MAVLINK_TYPE_FLOAT, 0, 12, offsetof(mavlink_esea_control_out_t, apart_Nm) }, \
         { "room_Nm", NULL, MAVLINK_TYPE_FLOAT, 0, 16, offsetof(mavlink_esea_control_out_t, room_Nm) }, \
         { "surface_rad_s", NULL, MAVLINK_TYPE_FLOAT, 0, 20, offsetof(mavlink_esea_control_out_t, surface_rad_s) }, \
         { "u_eq_Nm", NULL, MAVLINK_TYPE_FLOAT, 0, 24, offsetof(mavlink_esea_control_out_t, u_eq_Nm) }, \
         { "k_smc_Nm", NULL, MAVLINK_TYPE_FLOAT, 0, 28, offsetof(mavlink_esea_control_out_t, k_smc_Nm) }, \
         { "set_trend_status", NULL, MAVLINK_TYPE_UINT32_T, 0, 32, offsetof(mavlink_esea_control_out_t, set_trend_status) }, \
         { "smc_status", NULL, MAVLINK_TYPE_UINT32_T, 0, 36, offsetof(mavlink_esea_control_out_t, smc_status) }, \
         { "redundancy_status", NULL, MAVLINK_TYPE_UINT32_T, 0, 40, offsetof(mavlink_esea_control_out_t, redundancy_status) }, \
         { "stamp_status", NULL, MAVLINK_TYPE_UINT32_T, 0, 44, offsetof(mavlink_esea_control_out_t, stamp_status) }, \
         { "step_ticks", NULL, MAVLINK_TYPE_UINT32_T, 0, 48, offsetof(mavlink_esea_control_out_t, step_ticks) }, \
         } \
}
#else
#define MAVLINK_MESSAGE_INFO_ESEA_CONTROL_OUT { \
    "ESEA_CONTROL_OUT", \
    13, \
    {  { "sequence", NULL, MAVLINK_TYPE_UINT32_T, 0, 0, offsetof(mavlink_esea_control_out_t, sequence) }, \
         { "u_command_Nm", NULL, MAVLINK_TYPE_FLOAT, 0, 4, offsetof(mavlink_esea_control_out_t, u_command_Nm) }, \
         { "apart_rad", NULL, MAVLINK_TYPE_FLOAT, 0, 8, offsetof(mavlink_esea_control_out_t, apart_rad) }, \
         { "apart_Nm", NULL, MAVLINK_TYPE_FLOAT, 0, 12, offsetof(mavlink_esea_control_out_t, apart_Nm) }, \
         { "room_Nm", NULL, MAVLINK_TYPE_FLOAT, 0, 16, offsetof(mavlink_esea_control_out_t, room_Nm) }, \
         { "surface_rad_s", NULL, MAVLINK_TYPE_FLOAT, 0, 20, offsetof(mavlink_esea_control_out_t, surface_rad_s) }, \
         { "u_eq_Nm", NULL, MAVLINK_TYPE_FLOAT, 0, 24, offsetof(mavlink_esea_control_out_t, u_eq_Nm) }, \
         { "k_smc_Nm", NULL, MAVLINK_TYPE_FLOAT, 0, 28, offsetof(mavlink_esea_control_out_t, k_smc_Nm) }, \
         { "set_trend_status", NULL, MAVLINK_TYPE_UINT32_T, 0, 32, offsetof(mavlink_esea_control_out_t, set_trend_status) }, \
         { "smc_status", NULL, MAVLINK_TYPE_UINT32_T, 0, 36, offsetof(mavlink_esea_control_out_t, smc_status) }, \
         { "redundancy_status", NULL, MAVLINK_TYPE_UINT32_T, 0, 40, offsetof(mavlink_esea_control_out_t, redundancy_status) }, \
         { "stamp_status", NULL, MAVLINK_TYPE_UINT32_T, 0, 44, offsetof(mavlink_esea_control_out_t, stamp_status) }, \
         { "step_ticks", NULL, MAVLINK_TYPE_UINT32_T, 0, 48, offsetof(mavlink_esea_control_out_t, step_ticks) }, \
         } \
}
#endif

/**
 * @brief Pack a esea_control_out message
 * @param system_id ID of this system
 * @param component_id ID of this component (e.g. 200 for IMU)
 * @param msg The MAVLink message to compress the data into
 *
 * @param sequence  Base tick of this run of the task.
 * @param u_command_Nm  command at the motor shaft; [Nm], range -0.220999986 to 0.220999986; eq. (5.22)
 * @param apart_rad [rad] drive's angle less the motor side's; [rad], range -15.8091927 to 15.8091927
 * @param apart_Nm  torque at the drive that nothing explains; [Nm], range -16.3703518 to 16.3703518
 * @param room_Nm  how large that may be now; [Nm], range 0 to 30.1256943
 * @param surface_rad_s [rad/s] surface; [rad/s], range -168.167984 to 168.167984; eq. (5.12)
 * @param u_eq_Nm  equivalent control; [Nm], range -29.0375538 to 29.0375538; eq. (5.16)
 * @param k_smc_Nm  switching gain; [Nm], range 0 to 10.9715872; eq. (5.20)
 * @param set_trend_status  what is known of it; bits below
 * @param smc_status  what is known of this command; bits below
 * @param redundancy_status  what is known of this sample; bits below
 * @param stamp_status  what is known of this command; bits below
 * @param step_ticks  Timer ticks of the step, measuring included (empty_ticks).
 * @return length of the message in bytes (excluding serial stream start sign)
 */
static inline uint16_t mavlink_msg_esea_control_out_pack(uint8_t system_id, uint8_t component_id, mavlink_message_t* msg,
                               uint32_t sequence, float u_command_Nm, float apart_rad, float apart_Nm, float room_Nm, float surface_rad_s, float u_eq_Nm, float k_smc_Nm, uint32_t set_trend_status, uint32_t smc_status, uint32_t redundancy_status, uint32_t stamp_status, uint32_t step_ticks)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    char buf[MAVLINK_MSG_ID_ESEA_CONTROL_OUT_LEN];
    _mav_put_uint32_t(buf, 0, sequence);
    _mav_put_float(buf, 4, u_command_Nm);
    _mav_put_float(buf, 8, apart_rad);
    _mav_put_float(buf, 12, apart_Nm);
    _mav_put_float(buf, 16, room_Nm);
    _mav_put_float(buf, 20, surface_rad_s);
    _mav_put_float(buf, 24, u_eq_Nm);
    _mav_put_float(buf, 28, k_smc_Nm);
    _mav_put_uint32_t(buf, 32, set_trend_status);
    _mav_put_uint32_t(buf, 36, smc_status);
    _mav_put_uint32_t(buf, 40, redundancy_status);
    _mav_put_uint32_t(buf, 44, stamp_status);
    _mav_put_uint32_t(buf, 48, step_ticks);

        memcpy(_MAV_PAYLOAD_NON_CONST(msg), buf, MAVLINK_MSG_ID_ESEA_CONTROL_OUT_LEN);
#else
    mavlink_esea_control_out_t packet;
    packet.sequence = sequence;
    packet.u_command_Nm = u_command_Nm;
    packet.apart_rad = apart_rad;
    packet.apart_Nm = apart_Nm;
    packet.room_Nm = room_Nm;
    packet.surface_rad_s = surface_rad_s;
    packet.u_eq_Nm = u_eq_Nm;
    packet.k_smc_Nm = k_smc_Nm;
    packet.set_trend_status = set_trend_status;
    packet.smc_status = smc_status;
    packet.redundancy_status = redundancy_status;
    packet.stamp_status = stamp_status;
    packet.step_ticks = step_ticks;

        memcpy(_MAV_PAYLOAD_NON_CONST(msg), &packet, MAVLINK_MSG_ID_ESEA_CONTROL_OUT_LEN);
#endif

    msg->msgid = MAVLINK_MSG_ID_ESEA_CONTROL_OUT;
    return mavlink_finalize_message(msg, system_id, component_id, MAVLINK_MSG_ID_ESEA_CONTROL_OUT_MIN_LEN, MAVLINK_MSG_ID_ESEA_CONTROL_OUT_LEN, MAVLINK_MSG_ID_ESEA_CONTROL_OUT_CRC);
}

/**
 * @brief Pack a esea_control_out message
 * @param system_id ID of this system
 * @param component_id ID of this component (e.g. 200 for IMU)
 * @param status MAVLink status structure
 * @param msg The MAVLink message to compress the data into
 *
 * @param sequence  Base tick of this run of the task.
 * @param u_command_Nm  command at the motor shaft; [Nm], range -0.220999986 to 0.220999986; eq. (5.22)
 * @param apart_rad [rad] drive's angle less the motor side's; [rad], range -15.8091927 to 15.8091927
 * @param apart_Nm  torque at the drive that nothing explains; [Nm], range -16.3703518 to 16.3703518
 * @param room_Nm  how large that may be now; [Nm], range 0 to 30.1256943
 * @param surface_rad_s [rad/s] surface; [rad/s], range -168.167984 to 168.167984; eq. (5.12)
 * @param u_eq_Nm  equivalent control; [Nm], range -29.0375538 to 29.0375538; eq. (5.16)
 * @param k_smc_Nm  switching gain; [Nm], range 0 to 10.9715872; eq. (5.20)
 * @param set_trend_status  what is known of it; bits below
 * @param smc_status  what is known of this command; bits below
 * @param redundancy_status  what is known of this sample; bits below
 * @param stamp_status  what is known of this command; bits below
 * @param step_ticks  Timer ticks of the step, measuring included (empty_ticks).
 * @return length of the message in bytes (excluding serial stream start sign)
 */
static inline uint16_t mavlink_msg_esea_control_out_pack_status(uint8_t system_id, uint8_t component_id, mavlink_status_t *_status, mavlink_message_t* msg,
                               uint32_t sequence, float u_command_Nm, float apart_rad, float apart_Nm, float room_Nm, float surface_rad_s, float u_eq_Nm, float k_smc_Nm, uint32_t set_trend_status, uint32_t smc_status, uint32_t redundancy_status, uint32_t stamp_status, uint32_t step_ticks)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    char buf[MAVLINK_MSG_ID_ESEA_CONTROL_OUT_LEN];
    _mav_put_uint32_t(buf, 0, sequence);
    _mav_put_float(buf, 4, u_command_Nm);
    _mav_put_float(buf, 8, apart_rad);
    _mav_put_float(buf, 12, apart_Nm);
    _mav_put_float(buf, 16, room_Nm);
    _mav_put_float(buf, 20, surface_rad_s);
    _mav_put_float(buf, 24, u_eq_Nm);
    _mav_put_float(buf, 28, k_smc_Nm);
    _mav_put_uint32_t(buf, 32, set_trend_status);
    _mav_put_uint32_t(buf, 36, smc_status);
    _mav_put_uint32_t(buf, 40, redundancy_status);
    _mav_put_uint32_t(buf, 44, stamp_status);
    _mav_put_uint32_t(buf, 48, step_ticks);

        memcpy(_MAV_PAYLOAD_NON_CONST(msg), buf, MAVLINK_MSG_ID_ESEA_CONTROL_OUT_LEN);
#else
    mavlink_esea_control_out_t packet;
    packet.sequence = sequence;
    packet.u_command_Nm = u_command_Nm;
    packet.apart_rad = apart_rad;
    packet.apart_Nm = apart_Nm;
    packet.room_Nm = room_Nm;
    packet.surface_rad_s = surface_rad_s;
    packet.u_eq_Nm = u_eq_Nm;
    packet.k_smc_Nm = k_smc_Nm;
    packet.set_trend_status = set_trend_status;
    packet.smc_status = smc_status;
    packet.redundancy_status = redundancy_status;
    packet.stamp_status = stamp_status;
    packet.step_ticks = step_ticks;

        memcpy(_MAV_PAYLOAD_NON_CONST(msg), &packet, MAVLINK_MSG_ID_ESEA_CONTROL_OUT_LEN);
#endif

    msg->msgid = MAVLINK_MSG_ID_ESEA_CONTROL_OUT;
#if MAVLINK_CRC_EXTRA
    return mavlink_finalize_message_buffer(msg, system_id, component_id, _status, MAVLINK_MSG_ID_ESEA_CONTROL_OUT_MIN_LEN, MAVLINK_MSG_ID_ESEA_CONTROL_OUT_LEN, MAVLINK_MSG_ID_ESEA_CONTROL_OUT_CRC);
#else
    return mavlink_finalize_message_buffer(msg, system_id, component_id, _status, MAVLINK_MSG_ID_ESEA_CONTROL_OUT_MIN_LEN, MAVLINK_MSG_ID_ESEA_CONTROL_OUT_LEN);
#endif
}

/**
 * @brief Pack a esea_control_out message on a channel
 * @param system_id ID of this system
 * @param component_id ID of this component (e.g. 200 for IMU)
 * @param chan The MAVLink channel this message will be sent over
 * @param msg The MAVLink message to compress the data into
 * @param sequence  Base tick of this run of the task.
 * @param u_command_Nm  command at the motor shaft; [Nm], range -0.220999986 to 0.220999986; eq. (5.22)
 * @param apart_rad [rad] drive's angle less the motor side's; [rad], range -15.8091927 to 15.8091927
 * @param apart_Nm  torque at the drive that nothing explains; [Nm], range -16.3703518 to 16.3703518
 * @param room_Nm  how large that may be now; [Nm], range 0 to 30.1256943
 * @param surface_rad_s [rad/s] surface; [rad/s], range -168.167984 to 168.167984; eq. (5.12)
 * @param u_eq_Nm  equivalent control; [Nm], range -29.0375538 to 29.0375538; eq. (5.16)
 * @param k_smc_Nm  switching gain; [Nm], range 0 to 10.9715872; eq. (5.20)
 * @param set_trend_status  what is known of it; bits below
 * @param smc_status  what is known of this command; bits below
 * @param redundancy_status  what is known of this sample; bits below
 * @param stamp_status  what is known of this command; bits below
 * @param step_ticks  Timer ticks of the step, measuring included (empty_ticks).
 * @return length of the message in bytes (excluding serial stream start sign)
 */
static inline uint16_t mavlink_msg_esea_control_out_pack_chan(uint8_t system_id, uint8_t component_id, uint8_t chan,
                               mavlink_message_t* msg,
                                   uint32_t sequence,float u_command_Nm,float apart_rad,float apart_Nm,float room_Nm,float surface_rad_s,float u_eq_Nm,float k_smc_Nm,uint32_t set_trend_status,uint32_t smc_status,uint32_t redundancy_status,uint32_t stamp_status,uint32_t step_ticks)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    char buf[MAVLINK_MSG_ID_ESEA_CONTROL_OUT_LEN];
    _mav_put_uint32_t(buf, 0, sequence);
    _mav_put_float(buf, 4, u_command_Nm);
    _mav_put_float(buf, 8, apart_rad);
    _mav_put_float(buf, 12, apart_Nm);
    _mav_put_float(buf, 16, room_Nm);
    _mav_put_float(buf, 20, surface_rad_s);
    _mav_put_float(buf, 24, u_eq_Nm);
    _mav_put_float(buf, 28, k_smc_Nm);
    _mav_put_uint32_t(buf, 32, set_trend_status);
    _mav_put_uint32_t(buf, 36, smc_status);
    _mav_put_uint32_t(buf, 40, redundancy_status);
    _mav_put_uint32_t(buf, 44, stamp_status);
    _mav_put_uint32_t(buf, 48, step_ticks);

        memcpy(_MAV_PAYLOAD_NON_CONST(msg), buf, MAVLINK_MSG_ID_ESEA_CONTROL_OUT_LEN);
#else
    mavlink_esea_control_out_t packet;
    packet.sequence = sequence;
    packet.u_command_Nm = u_command_Nm;
    packet.apart_rad = apart_rad;
    packet.apart_Nm = apart_Nm;
    packet.room_Nm = room_Nm;
    packet.surface_rad_s = surface_rad_s;
    packet.u_eq_Nm = u_eq_Nm;
    packet.k_smc_Nm = k_smc_Nm;
    packet.set_trend_status = set_trend_status;
    packet.smc_status = smc_status;
    packet.redundancy_status = redundancy_status;
    packet.stamp_status = stamp_status;
    packet.step_ticks = step_ticks;

        memcpy(_MAV_PAYLOAD_NON_CONST(msg), &packet, MAVLINK_MSG_ID_ESEA_CONTROL_OUT_LEN);
#endif

    msg->msgid = MAVLINK_MSG_ID_ESEA_CONTROL_OUT;
    return mavlink_finalize_message_chan(msg, system_id, component_id, chan, MAVLINK_MSG_ID_ESEA_CONTROL_OUT_MIN_LEN, MAVLINK_MSG_ID_ESEA_CONTROL_OUT_LEN, MAVLINK_MSG_ID_ESEA_CONTROL_OUT_CRC);
}

/**
 * @brief Encode a esea_control_out struct
 *
 * @param system_id ID of this system
 * @param component_id ID of this component (e.g. 200 for IMU)
 * @param msg The MAVLink message to compress the data into
 * @param esea_control_out C-struct to read the message contents from
 */
static inline uint16_t mavlink_msg_esea_control_out_encode(uint8_t system_id, uint8_t component_id, mavlink_message_t* msg, const mavlink_esea_control_out_t* esea_control_out)
{
    return mavlink_msg_esea_control_out_pack(system_id, component_id, msg, esea_control_out->sequence, esea_control_out->u_command_Nm, esea_control_out->apart_rad, esea_control_out->apart_Nm, esea_control_out->room_Nm, esea_control_out->surface_rad_s, esea_control_out->u_eq_Nm, esea_control_out->k_smc_Nm, esea_control_out->set_trend_status, esea_control_out->smc_status, esea_control_out->redundancy_status, esea_control_out->stamp_status, esea_control_out->step_ticks);
}

/**
 * @brief Encode a esea_control_out struct on a channel
 *
 * @param system_id ID of this system
 * @param component_id ID of this component (e.g. 200 for IMU)
 * @param chan The MAVLink channel this message will be sent over
 * @param msg The MAVLink message to compress the data into
 * @param esea_control_out C-struct to read the message contents from
 */
static inline uint16_t mavlink_msg_esea_control_out_encode_chan(uint8_t system_id, uint8_t component_id, uint8_t chan, mavlink_message_t* msg, const mavlink_esea_control_out_t* esea_control_out)
{
    return mavlink_msg_esea_control_out_pack_chan(system_id, component_id, chan, msg, esea_control_out->sequence, esea_control_out->u_command_Nm, esea_control_out->apart_rad, esea_control_out->apart_Nm, esea_control_out->room_Nm, esea_control_out->surface_rad_s, esea_control_out->u_eq_Nm, esea_control_out->k_smc_Nm, esea_control_out->set_trend_status, esea_control_out->smc_status, esea_control_out->redundancy_status, esea_control_out->stamp_status, esea_control_out->step_ticks);
}

/**
 * @brief Encode a esea_control_out struct with provided status structure
 *
 * @param system_id ID of this system
 * @param component_id ID of this component (e.g. 200 for IMU)
 * @param status MAVLink status structure
 * @param msg The MAVLink message to compress the data into
 * @param esea_control_out C-struct to read the message contents from
 */
static inline uint16_t mavlink_msg_esea_control_out_encode_status(uint8_t system_id, uint8_t component_id, mavlink_status_t* _status, mavlink_message_t* msg, const mavlink_esea_control_out_t* esea_control_out)
{
    return mavlink_msg_esea_control_out_pack_status(system_id, component_id, _status, msg,  esea_control_out->sequence, esea_control_out->u_command_Nm, esea_control_out->apart_rad, esea_control_out->apart_Nm, esea_control_out->room_Nm, esea_control_out->surface_rad_s, esea_control_out->u_eq_Nm, esea_control_out->k_smc_Nm, esea_control_out->set_trend_status, esea_control_out->smc_status, esea_control_out->redundancy_status, esea_control_out->stamp_status, esea_control_out->step_ticks);
}

/**
 * @brief Send a esea_control_out message
 * @param chan MAVLink channel to send the message
 *
 * @param sequence  Base tick of this run of the task.
 * @param u_command_Nm  command at the motor shaft; [Nm], range -0.220999986 to 0.220999986; eq. (5.22)
 * @param apart_rad [rad] drive's angle less the motor side's; [rad], range -15.8091927 to 15.8091927
 * @param apart_Nm  torque at the drive that nothing explains; [Nm], range -16.3703518 to 16.3703518
 * @param room_Nm  how large that may be now; [Nm], range 0 to 30.1256943
 * @param surface_rad_s [rad/s] surface; [rad/s], range -168.167984 to 168.167984; eq. (5.12)
 * @param u_eq_Nm  equivalent control; [Nm], range -29.0375538 to 29.0375538; eq. (5.16)
 * @param k_smc_Nm  switching gain; [Nm], range 0 to 10.9715872; eq. (5.20)
 * @param set_trend_status  what is known of it; bits below
 * @param smc_status  what is known of this command; bits below
 * @param redundancy_status  what is known of this sample; bits below
 * @param stamp_status  what is known of this command; bits below
 * @param step_ticks  Timer ticks of the step, measuring included (empty_ticks).
 */
#ifdef MAVLINK_USE_CONVENIENCE_FUNCTIONS

static inline void mavlink_msg_esea_control_out_send(mavlink_channel_t chan, uint32_t sequence, float u_command_Nm, float apart_rad, float apart_Nm, float room_Nm, float surface_rad_s, float u_eq_Nm, float k_smc_Nm, uint32_t set_trend_status, uint32_t smc_status, uint32_t redundancy_status, uint32_t stamp_status, uint32_t step_ticks)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    char buf[MAVLINK_MSG_ID_ESEA_CONTROL_OUT_LEN];
    _mav_put_uint32_t(buf, 0, sequence);
    _mav_put_float(buf, 4, u_command_Nm);
    _mav_put_float(buf, 8, apart_rad);
    _mav_put_float(buf, 12, apart_Nm);
    _mav_put_float(buf, 16, room_Nm);
    _mav_put_float(buf, 20, surface_rad_s);
    _mav_put_float(buf, 24, u_eq_Nm);
    _mav_put_float(buf, 28, k_smc_Nm);
    _mav_put_uint32_t(buf, 32, set_trend_status);
    _mav_put_uint32_t(buf, 36, smc_status);
    _mav_put_uint32_t(buf, 40, redundancy_status);
    _mav_put_uint32_t(buf, 44, stamp_status);
    _mav_put_uint32_t(buf, 48, step_ticks);

    _mav_finalize_message_chan_send(chan, MAVLINK_MSG_ID_ESEA_CONTROL_OUT, buf, MAVLINK_MSG_ID_ESEA_CONTROL_OUT_MIN_LEN, MAVLINK_MSG_ID_ESEA_CONTROL_OUT_LEN, MAVLINK_MSG_ID_ESEA_CONTROL_OUT_CRC);
#else
    mavlink_esea_control_out_t packet;
    packet.sequence = sequence;
    packet.u_command_Nm = u_command_Nm;
    packet.apart_rad = apart_rad;
    packet.apart_Nm = apart_Nm;
    packet.room_Nm = room_Nm;
    packet.surface_rad_s = surface_rad_s;
    packet.u_eq_Nm = u_eq_Nm;
    packet.k_smc_Nm = k_smc_Nm;
    packet.set_trend_status = set_trend_status;
    packet.smc_status = smc_status;
    packet.redundancy_status = redundancy_status;
    packet.stamp_status = stamp_status;
    packet.step_ticks = step_ticks;

    _mav_finalize_message_chan_send(chan, MAVLINK_MSG_ID_ESEA_CONTROL_OUT, (const char *)&packet, MAVLINK_MSG_ID_ESEA_CONTROL_OUT_MIN_LEN, MAVLINK_MSG_ID_ESEA_CONTROL_OUT_LEN, MAVLINK_MSG_ID_ESEA_CONTROL_OUT_CRC);
#endif
}

/**
 * @brief Send a esea_control_out message
 * @param chan MAVLink channel to send the message
 * @param struct The MAVLink struct to serialize
 */
static inline void mavlink_msg_esea_control_out_send_struct(mavlink_channel_t chan, const mavlink_esea_control_out_t* esea_control_out)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    mavlink_msg_esea_control_out_send(chan, esea_control_out->sequence, esea_control_out->u_command_Nm, esea_control_out->apart_rad, esea_control_out->apart_Nm, esea_control_out->room_Nm, esea_control_out->surface_rad_s, esea_control_out->u_eq_Nm, esea_control_out->k_smc_Nm, esea_control_out->set_trend_status, esea_control_out->smc_status, esea_control_out->redundancy_status, esea_control_out->stamp_status, esea_control_out->step_ticks);
#else
    _mav_finalize_message_chan_send(chan, MAVLINK_MSG_ID_ESEA_CONTROL_OUT, (const char *)esea_control_out, MAVLINK_MSG_ID_ESEA_CONTROL_OUT_MIN_LEN, MAVLINK_MSG_ID_ESEA_CONTROL_OUT_LEN, MAVLINK_MSG_ID_ESEA_CONTROL_OUT_CRC);
#endif
}

#if MAVLINK_MSG_ID_ESEA_CONTROL_OUT_LEN <= MAVLINK_MAX_PAYLOAD_LEN
/*
  This variant of _send() can be used to save stack space by reusing
  memory from the receive buffer.  The caller provides a
  mavlink_message_t which is the size of a full mavlink message. This
  is usually the receive buffer for the channel, and allows a reply to an
  incoming message with minimum stack space usage.
 */
static inline void mavlink_msg_esea_control_out_send_buf(mavlink_message_t *msgbuf, mavlink_channel_t chan,  uint32_t sequence, float u_command_Nm, float apart_rad, float apart_Nm, float room_Nm, float surface_rad_s, float u_eq_Nm, float k_smc_Nm, uint32_t set_trend_status, uint32_t smc_status, uint32_t redundancy_status, uint32_t stamp_status, uint32_t step_ticks)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    char *buf = (char *)msgbuf;
    _mav_put_uint32_t(buf, 0, sequence);
    _mav_put_float(buf, 4, u_command_Nm);
    _mav_put_float(buf, 8, apart_rad);
    _mav_put_float(buf, 12, apart_Nm);
    _mav_put_float(buf, 16, room_Nm);
    _mav_put_float(buf, 20, surface_rad_s);
    _mav_put_float(buf, 24, u_eq_Nm);
    _mav_put_float(buf, 28, k_smc_Nm);
    _mav_put_uint32_t(buf, 32, set_trend_status);
    _mav_put_uint32_t(buf, 36, smc_status);
    _mav_put_uint32_t(buf, 40, redundancy_status);
    _mav_put_uint32_t(buf, 44, stamp_status);
    _mav_put_uint32_t(buf, 48, step_ticks);

    _mav_finalize_message_chan_send(chan, MAVLINK_MSG_ID_ESEA_CONTROL_OUT, buf, MAVLINK_MSG_ID_ESEA_CONTROL_OUT_MIN_LEN, MAVLINK_MSG_ID_ESEA_CONTROL_OUT_LEN, MAVLINK_MSG_ID_ESEA_CONTROL_OUT_CRC);
#else
    mavlink_esea_control_out_t *packet = (mavlink_esea_control_out_t *)msgbuf;
    packet->sequence = sequence;
    packet->u_command_Nm = u_command_Nm;
    packet->apart_rad = apart_rad;
    packet->apart_Nm = apart_Nm;
    packet->room_Nm = room_Nm;
    packet->surface_rad_s = surface_rad_s;
    packet->u_eq_Nm = u_eq_Nm;
    packet->k_smc_Nm = k_smc_Nm;
    packet->set_trend_status = set_trend_status;
    packet->smc_status = smc_status;
    packet->redundancy_status = redundancy_status;
    packet->stamp_status = stamp_status;
    packet->step_ticks = step_ticks;

    _mav_finalize_message_chan_send(chan, MAVLINK_MSG_ID_ESEA_CONTROL_OUT, (const char *)packet, MAVLINK_MSG_ID_ESEA_CONTROL_OUT_MIN_LEN, MAVLINK_MSG_ID_ESEA_CONTROL_OUT_LEN, MAVLINK_MSG_ID_ESEA_CONTROL_OUT_CRC);
#endif
}
#endif

#endif

// MESSAGE ESEA_CONTROL_OUT UNPACKING


/**
 * @brief Get field sequence from esea_control_out message
 *
 * @return  Base tick of this run of the task.
 */
static inline uint32_t mavlink_msg_esea_control_out_get_sequence(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint32_t(msg,  0);
}

/**
 * @brief Get field u_command_Nm from esea_control_out message
 *
 * @return  command at the motor shaft; [Nm], range -0.220999986 to 0.220999986; eq. (5.22)
 */
static inline float mavlink_msg_esea_control_out_get_u_command_Nm(const mavlink_message_t* msg)
{
    return _MAV_RETURN_float(msg,  4);
}

/**
 * @brief Get field apart_rad from esea_control_out message
 *
 * @return [rad] drive's angle less the motor side's; [rad], range -15.8091927 to 15.8091927
 */
static inline float mavlink_msg_esea_control_out_get_apart_rad(const mavlink_message_t* msg)
{
    return _MAV_RETURN_float(msg,  8);
}

/**
 * @brief Get field apart_Nm from esea_control_out message
 *
 * @return  torque at the drive that nothing explains; [Nm], range -16.3703518 to 16.3703518
 */
static inline float mavlink_msg_esea_control_out_get_apart_Nm(const mavlink_message_t* msg)
{
    return _MAV_RETURN_float(msg,  12);
}

/**
 * @brief Get field room_Nm from esea_control_out message
 *
 * @return  how large that may be now; [Nm], range 0 to 30.1256943
 */
static inline float mavlink_msg_esea_control_out_get_room_Nm(const mavlink_message_t* msg)
{
    return _MAV_RETURN_float(msg,  16);
}

/**
 * @brief Get field surface_rad_s from esea_control_out message
 *
 * @return [rad/s] surface; [rad/s], range -168.167984 to 168.167984; eq. (5.12)
 */
static inline float mavlink_msg_esea_control_out_get_surface_rad_s(const mavlink_message_t* msg)
{
    return _MAV_RETURN_float(msg,  20);
}

/**
 * @brief Get field u_eq_Nm from esea_control_out message
 *
 * @return  equivalent control; [Nm], range -29.0375538 to 29.0375538; eq. (5.16)
 */
static inline float mavlink_msg_esea_control_out_get_u_eq_Nm(const mavlink_message_t* msg)
{
    return _MAV_RETURN_float(msg,  24);
}

/**
 * @brief Get field k_smc_Nm from esea_control_out message
 *
 * @return  switching gain; [Nm], range 0 to 10.9715872; eq. (5.20)
 */
static inline float mavlink_msg_esea_control_out_get_k_smc_Nm(const mavlink_message_t* msg)
{
    return _MAV_RETURN_float(msg,  28);
}

/**
 * @brief Get field set_trend_status from esea_control_out message
 *
 * @return  what is known of it; bits below
 */
static inline uint32_t mavlink_msg_esea_control_out_get_set_trend_status(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint32_t(msg,  32);
}

/**
 * @brief Get field smc_status from esea_control_out message
 *
 * @return  what is known of this command; bits below
 */
static inline uint32_t mavlink_msg_esea_control_out_get_smc_status(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint32_t(msg,  36);
}

/**
 * @brief Get field redundancy_status from esea_control_out message
 *
 * @return  what is known of this sample; bits below
 */
static inline uint32_t mavlink_msg_esea_control_out_get_redundancy_status(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint32_t(msg,  40);
}

/**
 * @brief Get field stamp_status from esea_control_out message
 *
 * @return  what is known of this command; bits below
 */
static inline uint32_t mavlink_msg_esea_control_out_get_stamp_status(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint32_t(msg,  44);
}

/**
 * @brief Get field step_ticks from esea_control_out message
 *
 * @return  Timer ticks of the step, measuring included (empty_ticks).
 */
static inline uint32_t mavlink_msg_esea_control_out_get_step_ticks(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint32_t(msg,  48);
}

/**
 * @brief Decode a esea_control_out message into a struct
 *
 * @param msg The message to decode
 * @param esea_control_out C-struct to decode the message contents into
 */
static inline void mavlink_msg_esea_control_out_decode(const mavlink_message_t* msg, mavlink_esea_control_out_t* esea_control_out)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    esea_control_out->sequence = mavlink_msg_esea_control_out_get_sequence(msg);
    esea_control_out->u_command_Nm = mavlink_msg_esea_control_out_get_u_command_Nm(msg);
    esea_control_out->apart_rad = mavlink_msg_esea_control_out_get_apart_rad(msg);
    esea_control_out->apart_Nm = mavlink_msg_esea_control_out_get_apart_Nm(msg);
    esea_control_out->room_Nm = mavlink_msg_esea_control_out_get_room_Nm(msg);
    esea_control_out->surface_rad_s = mavlink_msg_esea_control_out_get_surface_rad_s(msg);
    esea_control_out->u_eq_Nm = mavlink_msg_esea_control_out_get_u_eq_Nm(msg);
    esea_control_out->k_smc_Nm = mavlink_msg_esea_control_out_get_k_smc_Nm(msg);
    esea_control_out->set_trend_status = mavlink_msg_esea_control_out_get_set_trend_status(msg);
    esea_control_out->smc_status = mavlink_msg_esea_control_out_get_smc_status(msg);
    esea_control_out->redundancy_status = mavlink_msg_esea_control_out_get_redundancy_status(msg);
    esea_control_out->stamp_status = mavlink_msg_esea_control_out_get_stamp_status(msg);
    esea_control_out->step_ticks = mavlink_msg_esea_control_out_get_step_ticks(msg);
#else
        uint8_t len = msg->len < MAVLINK_MSG_ID_ESEA_CONTROL_OUT_LEN? msg->len : MAVLINK_MSG_ID_ESEA_CONTROL_OUT_LEN;
        memset(esea_control_out, 0, MAVLINK_MSG_ID_ESEA_CONTROL_OUT_LEN);
    memcpy(esea_control_out, _MAV_PAYLOAD(msg), len);
#endif
}
