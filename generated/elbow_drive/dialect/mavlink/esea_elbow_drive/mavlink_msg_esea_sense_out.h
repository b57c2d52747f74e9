#pragma once
// MESSAGE ESEA_SENSE_OUT PACKING

#include <stdint.h>

#define MAVLINK_MSG_ID_ESEA_SENSE_OUT 42602


typedef struct __mavlink_esea_sense_out_t {
 uint32_t sequence; /*<  Base tick of this run of the task.*/
 float u_Nm; /*<  motor torque, at the motor shaft; [Nm], range -0.220999986 to 0.220999986*/
 float tau_Nm; /*<  interaction torque on the load; [Nm], range -20 to 20; eq. (3.1)*/
 float tau_set_Nm; /*<  set torque, for the inverse; [Nm], range -4.46999979 to 4.46999979*/
 float theta_rad; /*< [rad] deflection: motor side minus load side; [rad], range -0.349999994 to 0.349999994*/
 float theta_motor_rad; /*< [rad] joint angle, motor or load side of the coupling; held, at first at count 0, while the encoder is not usable; [rad], range -35 to 35*/
 float theta_load_rad; /*< [rad] joint angle, motor or load side of the coupling; held, at first at count 0, while the encoder is not usable; [rad], range -35 to 35*/
 float omega_motor_rad_s; /*< [rad/s] filtered rate of the angle; [rad/s], range -12 to 12*/
 float omega_load_rad_s; /*< [rad/s] filtered rate of the angle; [rad/s], range -12 to 12*/
 float delta_set_rad; /*< [rad] deflection set-point; [rad], range -0.349999994 to 0.349999994*/
 float tau_h_Nm; /*<  torque of the person; [Nm], range -20 to 20*/
 float d4_rad_s2; /*<  disturbance of the drive; [rad/s^2], range -24.666666 to 24.666666; eq. (5.5)*/
 float energy_J; /*<  energy given to the limb within the window; [J], range 0 to 269.306396*/
 float fault; /*<  first reason of the latch, one of the FAULT numbers; 0 when released; [dimensionless], range 0 to 15*/
 float mode_held; /*<  mode that holds in this step; [dimensionless], range 0 to 2*/
 float damping_Nms_rad; /*<  damping added to what is wanted; [Nm s/rad], range 0 to 0.350349993*/
 float given_J; /*<  energy given beyond the wanted torque's; [J], range 0 to 120.119995*/
 float held_J; /*<  that, and what drive and command may still give; [J], range 0 to 173.559555*/
 float adapted_gain; /*<  model's torque over the true one; [dimensionless], range 0.769230723 to 1.42857134*/
 float adapted_loss; /*<  stop operator's share in the model's torque; [dimensionless], range -0.399999976 to 0.399999976*/
 float adapted_offset_Nm; /*<  what the model shows without torque; [Nm], range -0.299999982 to 0.299999982*/
 uint32_t encoder_motor_status; /*<  what is known of this sample; bits below*/
 uint32_t encoder_load_status; /*<  what is known of this sample; bits below*/
 uint32_t joint_status; /*<  what is known of this sample; bits below*/
 uint32_t velocity_status; /*<  what is known of this sample; bits below*/
 uint32_t sensor_status; /*<  what is known of this sample; bits below*/
 uint32_t motor_rate_status; /*<  what is known of this sample; bits below*/
 uint32_t load_rate_status; /*<  what is known of this sample; bits below*/
 uint32_t encoder_gear_status; /*<  what is known of this sample; bits below*/
 uint32_t adaptation_status; /*<  what is known of it; bits below*/
 uint32_t reference_status; /*<  what is known of this set torque; bits below*/
 uint32_t passivity_status; /*<  what is known of this step; bits below*/
 uint32_t lead_status; /*<  what is known of it; bits below*/
 uint32_t inverse_status; /*<  what is known of this set-point; bits below*/
 uint32_t setpoint_status; /*<  what is known of this set-point; bits below*/
 uint32_t smooth_status; /*<  what is known of it; bits below*/
 uint32_t limits_status; /*<  which limits act, and what holds the latch; bits below*/
 uint32_t drive_status; /*<  what is known of this estimate; bits below*/
 uint32_t gear_status; /*<  what is known of this estimate; bits below*/
 uint32_t human_status; /*<  what is known of this estimate; bits below*/
 uint32_t set_rate_status; /*<  what is known of this sample; bits below*/
 uint32_t step_ticks; /*<  Timer ticks of the step, measuring included (empty_ticks).*/
} mavlink_esea_sense_out_t;

#define MAVLINK_MSG_ID_ESEA_SENSE_OUT_LEN 168
#define MAVLINK_MSG_ID_ESEA_SENSE_OUT_MIN_LEN 168
#define MAVLINK_MSG_ID_42602_LEN 168
#define MAVLINK_MSG_ID_42602_MIN_LEN 168

#define MAVLINK_MSG_ID_ESEA_SENSE_OUT_CRC 180
#define MAVLINK_MSG_ID_42602_CRC 180



#if MAVLINK_COMMAND_24BIT
#define MAVLINK_MESSAGE_INFO_ESEA_SENSE_OUT { \
    42602, \
    "ESEA_SENSE_OUT", \
    42, \
    {  { "sequence", NULL, MAVLINK_TYPE_UINT32_T, 0, 0, offsetof(mavlink_esea_sense_out_t, sequence) }, \
         { "u_Nm", NULL, MAVLINK_TYPE_FLOAT, 0, 4, offsetof(mavlink_esea_sense_out_t, u_Nm) }, \
         { "tau_Nm", NULL, MAVLINK_TYPE_FLOAT, 0, 8, offsetof(mavlink_esea_sense_out_t, tau_Nm) }, \
         { "tau_set_Nm", NULL, MAVLINK_TYPE_FLOAT, 0, 12, offsetof(mavlink_esea_sense_out_t, tau_set_Nm) }, \
         { "theta_rad", NULL, MAVLINK_TYPE_FLOAT, 0, 16, offsetof(mavlink_esea_sense_out_t, theta_rad) }, \
         { "theta_motor_rad", NULL, MAVLINK_TYPE_FLOAT, 0, 20, offsetof(mavlink_esea_sense_out_t, theta_motor_rad) }, \
         { "theta_load_rad", NULL, MAVLINK_TYPE_FLOAT, 0, 24, offsetof(mavlink_esea_sense_out_t, theta_load_rad) }, \
         { "omega_motor_rad_s", NULL, MAVLINK_TYPE_FLOAT, 0, 28, offsetof(mavlink_esea_sense_out_t, omega_motor_rad_s) }, \
         { "omega_load_rad_s", NULL, MAVLINK_TYPE_FLOAT, 0, 32, offsetof(mavlink_esea_sense_out_t, omega_load_rad_s) }, \
         { "delta_set_rad", NULL, MAVLINK_TYPE_FLOAT, 0, 36, offsetof(mavlink_esea_sense_out_t, delta_set_rad) }, \
         { "tau_h_Nm", NULL, MAVLINK_TYPE_FLOAT, 0, 40, offsetof(mavlink_esea_sense_out_t, tau_h_Nm) }, \
         { "d4_rad_s2", NULL, MAVLINK_TYPE_FLOAT, 0, 44, offsetof(mavlink_esea_sense_out_t, d4_rad_s2) }, \
         { "energy_J", NULL, MAVLINK_TYPE_FLOAT, 0, 48, offsetof(mavlink_esea_sense_out_t, energy_J) }, \
         { "fault", NULL, MAVLINK_TYPE_FLOAT, 0, 52, offsetof(mavlink_esea_sense_out_t, fault) }, \
         { "mode_held", NULL, MAVLINK_TYPE_FLOAT, 0, 56, offsetof(mavlink_esea_sense_out_t, mode_held) }, \
         { "damping_Nms_rad", NULL, MAVLINK_TYPE_FLOAT, 0, 60, offsetof(mavlink_esea_sense_out_t, damping_Nms_rad) }, \
         { "given_J", NULL, MAVLINK_TYPE_FLOAT, 0, 64, offsetof(mavlink_esea_sense_out_t, given_J) }, \
         { "held_J", NULL, MAVLINK_TYPE_FLOAT, 0, 68, offsetof(mavlink_esea_sense_out_t, held_J) }, \
         { "adapted_gain", NULL, MAVLINK_TYPE_FLOAT, 0, 72, offsetof(mavlink_esea_sense_out_t, adapted_gain) }, \
         { "adapted_loss", NULL, MAVLINK_TYPE_FLOAT, 0, 76, offsetof(mavlink_esea_sense_out_t, adapted_loss) }, \
         { "adapted_offset_Nm", NULL, MAVLINK_TYPE_FLOAT, 0, 80, offsetof(mavlink_esea_sense_out_t, adapted_offset_Nm) }, \
         { "encoder_motor_status", NULL, MAVLINK_TYPE_UINT32_T, 0, 84, offsetof(mavlink_esea_sense_out_t, encoder_motor_status) }, \
         { "encoder_load_status", NULL, MAVLINK_TYPE_UINT32_T, 0, 88, offsetof(mavlink_esea_sense_out_t, encoder_load_status) }, \
         { "joint_status", NULL, MAVLINK_TYPE_UINT32_T, 0, 92, offsetof(mavlink_esea_sense_out_t, joint_status) }, \
         { "velocity_status", NULL, MAVLINK_TYPE_UINT32_T, 0, 96, offsetof(mavlink_esea_sense_out_t, velocity_status) }, \
         { "sensor_status", NULL, MAVLINK_TYPE_UINT32_T, 0, 100, offsetof(mavlink_esea_sense_out_t, sensor_status) }, \
         { "motor_rate_status", NULL, MAVLINK_TYPE_UINT32_T, 0, 104, offsetof(mavlink_esea_sense_out_t, motor_rate_status) }, \
         { "load_rate_status", NULL, MAVLINK_TYPE_UINT32_T, 0, 108, offsetof(mavlink_esea_sense_out_t, load_rate_status) }, \
         { "encoder_gear_status", NULL, MAVLINK_TYPE_UINT32_T, 0, 112, offsetof(mavlink_esea_sense_out_t, encoder_gear_status) }, \
         { "adaptation_status", NULL, MAVLINK_TYPE_UINT32_T, 0, 116, offsetof(mavlink_esea_sense_out_t, adaptation_status) }, \
         { "reference_status", NULL, MAVLINK_TYPE_UINT32_T, 0, 120, offsetof(mavlink_esea_sense_out_t, reference_status) }, \
         { "passivity_status", NULL, MAVLINK_TYPE_UINT32_T, 0, 124, offsetof(mavlink_esea_sense_out_t, passivity_status) }, \
         { "lead_status", NULL, MAVLINK_TYPE_UINT32_T, 0, 128, offsetof(mavlink_esea_sense_out_t, lead_status) }, \
         { "inverse_status", NULL, MAVLINK_TYPE_UINT32_T, 0, 132, offsetof(mavlink_esea_sense_out_t, inverse_status) }, \
         { "setpoint_status", NULL, MAVLINK_TYPE_UINT32_T, 0, 136, offsetof(mavlink_esea_sense_out_t, setpoint_status) }, \
         { "smooth_status", NULL, MAVLINK_TYPE_UINT32_T, 0, 140, offsetof(mavlink_esea_sense_out_t, smooth_status) }, \
         { "limits_status", NULL, MAVLINK_TYPE_UINT32_T, 0, 144, offsetof(mavlink_esea_sense_out_t, limits_status) }, \
         { "drive_status", NULL, MAVLINK_TYPE_UINT32_T, 0, 148, offsetof(mavlink_esea_sense_out_t, drive_status) }, \
         { "gear_status", NULL, MAVLINK_TYPE_UINT32_T, 0, 152, offsetof(mavlink_esea_sense_out_t, gear_status) }, \
         { "human_status", NULL, MAVLINK_TYPE_UINT32_T, 0, 156, offsetof(mavlink_esea_sense_out_t, human_status) }, \
         { "set_rate_status", NULL, MAVLINK_TYPE_UINT32_T, 0, 160, offsetof(mavlink_esea_sense_out_t, set_rate_status) }, \
         { "step_ticks", NULL, MAVLINK_TYPE_UINT32_T, 0, 164, offsetof(mavlink_esea_sense_out_t, step_ticks) }, \
         } \
}
#else
#define MAVLINK_MESSAGE_INFO_ESEA_SENSE_OUT { \
    "ESEA_SENSE_OUT", \
    42, \
    {  { "sequence", NULL, MAVLINK_TYPE_UINT32_T, 0, 0, offsetof(mavlink_esea_sense_out_t, sequence) }, \
         { "u_Nm", NULL, MAVLINK_TYPE_FLOAT, 0, 4, offsetof(mavlink_esea_sense_out_t, u_Nm) }, \
         { "tau_Nm", NULL, MAVLINK_TYPE_FLOAT, 0, 8, offsetof(mavlink_esea_sense_out_t, tau_Nm) }, \
         { "tau_set_Nm", NULL, MAVLINK_TYPE_FLOAT, 0, 12, offsetof(mavlink_esea_sense_out_t, tau_set_Nm) }, \
         { "theta_rad", NULL, MAVLINK_TYPE_FLOAT, 0, 16, offsetof(mavlink_esea_sense_out_t, theta_rad) }, \
         { "theta_motor_rad", NULL, MAVLINK_TYPE_FLOAT, 0, 20, offsetof(mavlink_esea_sense_out_t, theta_motor_rad) }, \
         { "theta_load_rad", NULL, MAVLINK_TYPE_FLOAT, 0, 24, offsetof(mavlink_esea_sense_out_t, theta_load_rad) }, \
         { "omega_motor_rad_s", NULL, MAVLINK_TYPE_FLOAT, 0, 28, offsetof(mavlink_esea_sense_out_t, omega_motor_rad_s) }, \
         { "omega_load_rad_s", NULL, MAVLINK_TYPE_FLOAT, 0, 32, offsetof(mavlink_esea_sense_out_t, omega_load_rad_s) }, \
         { "delta_set_rad", NULL, MAVLINK_TYPE_FLOAT, 0, 36, offsetof(mavlink_esea_sense_out_t, delta_set_rad) }, \
         { "tau_h_Nm", NULL, MAVLINK_TYPE_FLOAT, 0, 40, offsetof(mavlink_esea_sense_out_t, tau_h_Nm) }, \
         { "d4_rad_s2", NULL, MAVLINK_TYPE_FLOAT, 0, 44, offsetof(mavlink_esea_sense_out_t, d4_rad_s2) }, \
         { "energy_J", NULL, MAVLINK_TYPE_FLOAT, 0, 48, offsetof(mavlink_esea_sense_out_t, energy_J) }, \
         { "fault", NULL, MAVLINK_TYPE_FLOAT, 0, 52, offsetof(mavlink_esea_sense_out_t, fault) }, \
         { "mode_held", NULL, MAVLINK_TYPE_FLOAT, 0, 56, offsetof(mavlink_esea_sense_out_t, mode_held) }, \
         { "damping_Nms_rad", NULL, MAVLINK_TYPE_FLOAT, 0, 60, offsetof(mavlink_esea_sense_out_t, damping_Nms_rad) }, \
         { "given_J", NULL, MAVLINK_TYPE_FLOAT, 0, 64, offsetof(mavlink_esea_sense_out_t, given_J) }, \
         { "held_J", NULL, MAVLINK_TYPE_FLOAT, 0, 68, offsetof(mavlink_esea_sense_out_t, held_J) }, \
         { "adapted_gain", NULL, MAVLINK_TYPE_FLOAT, 0, 72, offsetof(mavlink_esea_sense_out_t, adapted_gain) }, \
         { "adapted_loss", NULL, MAVLINK_TYPE_FLOAT, 0, 76, offsetof(mavlink_esea_sense_out_t, adapted_loss) }, \
         { "adapted_offset_Nm", NULL, MAVLINK_TYPE_FLOAT, 0, 80, offsetof(mavlink_esea_sense_out_t, adapted_offset_Nm) }, \
         { "encoder_motor_status", NULL, MAVLINK_TYPE_UINT32_T, 0, 84, offsetof(mavlink_esea_sense_out_t, encoder_motor_status) }, \
         { "encoder_load_status", NULL, MAVLINK_TYPE_UINT32_T, 0, 88, offsetof(mavlink_esea_sense_out_t, encoder_load_status) }, \
         { "joint_status", NULL, MAVLINK_TYPE_UINT32_T, 0, 92, offsetof(mavlink_esea_sense_out_t, joint_status) }, \
         { "velocity_status", NULL, MAVLINK_TYPE_UINT32_T, 0, 96, offsetof(mavlink_esea_sense_out_t, velocity_status) }, \
         { "sensor_status", NULL, MAVLINK_TYPE_UINT32_T, 0, 100, offsetof(mavlink_esea_sense_out_t, sensor_status) }, \
         { "motor_rate_status", NULL, MAVLINK_TYPE_UINT32_T, 0, 104, offsetof(mavlink_esea_sense_out_t, motor_rate_status) }, \
         { "load_rate_status", NULL, MAVLINK_TYPE_UINT32_T, 0, 108, offsetof(mavlink_esea_sense_out_t, load_rate_status) }, \
         { "encoder_gear_status", NULL, MAVLINK_TYPE_UINT32_T, 0, 112, offsetof(mavlink_esea_sense_out_t, encoder_gear_status) }, \
         { "adaptation_status", NULL, MAVLINK_TYPE_UINT32_T, 0, 116, offsetof(mavlink_esea_sense_out_t, adaptation_status) }, \
         { "reference_status", NULL, MAVLINK_TYPE_UINT32_T, 0, 120, offsetof(mavlink_esea_sense_out_t, reference_status) }, \
         { "passivity_status", NULL, MAVLINK_TYPE_UINT32_T, 0, 124, offsetof(mavlink_esea_sense_out_t, passivity_status) }, \
         { "lead_status", NULL, MAVLINK_TYPE_UINT32_T, 0, 128, offsetof(mavlink_esea_sense_out_t, lead_status) }, \
         { "inverse_status", NULL, MAVLINK_TYPE_UINT32_T, 0, 132, offsetof(mavlink_esea_sense_out_t, inverse_status) }, \
         { "setpoint_status", NULL, MAVLINK_TYPE_UINT32_T, 0, 136, offsetof(mavlink_esea_sense_out_t, setpoint_status) }, \
         { "smooth_status", NULL, MAVLINK_TYPE_UINT32_T, 0, 140, offsetof(mavlink_esea_sense_out_t, smooth_status) }, \
         { "limits_status", NULL, MAVLINK_TYPE_UINT32_T, 0, 144, offsetof(mavlink_esea_sense_out_t, limits_status) }, \
         { "drive_status", NULL, MAVLINK_TYPE_UINT32_T, 0, 148, offsetof(mavlink_esea_sense_out_t, drive_status) }, \
         { "gear_status", NULL, MAVLINK_TYPE_UINT32_T, 0, 152, offsetof(mavlink_esea_sense_out_t, gear_status) }, \
         { "human_status", NULL, MAVLINK_TYPE_UINT32_T, 0, 156, offsetof(mavlink_esea_sense_out_t, human_status) }, \
         { "set_rate_status", NULL, MAVLINK_TYPE_UINT32_T, 0, 160, offsetof(mavlink_esea_sense_out_t, set_rate_status) }, \
         { "step_ticks", NULL, MAVLINK_TYPE_UINT32_T, 0, 164, offsetof(mavlink_esea_sense_out_t, step_ticks) }, \
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
 * @param u_Nm  motor torque, at the motor shaft; [Nm], range -0.220999986 to 0.220999986
 * @param tau_Nm  interaction torque on the load; [Nm], range -20 to 20; eq. (3.1)
 * @param tau_set_Nm  set torque, for the inverse; [Nm], range -4.46999979 to 4.46999979
 * @param theta_rad [rad] deflection: motor side minus load side; [rad], range -0.349999994 to 0.349999994
 * @param theta_motor_rad [rad] joint angle, motor or load side of the coupling; held, at first at count 0, while the encoder is not usable; [rad], range -35 to 35
 * @param theta_load_rad [rad] joint angle, motor or load side of the coupling; held, at first at count 0, while the encoder is not usable; [rad], range -35 to 35
 * @param omega_motor_rad_s [rad/s] filtered rate of the angle; [rad/s], range -12 to 12
 * @param omega_load_rad_s [rad/s] filtered rate of the angle; [rad/s], range -12 to 12
 * @param delta_set_rad [rad] deflection set-point; [rad], range -0.349999994 to 0.349999994
 * @param tau_h_Nm  torque of the person; [Nm], range -20 to 20
 * @param d4_rad_s2  disturbance of the drive; [rad/s^2], range -24.666666 to 24.666666; eq. (5.5)
 * @param energy_J  energy given to the limb within the window; [J], range 0 to 269.306396
 * @param fault  first reason of the latch, one of the FAULT numbers; 0 when released; [dimensionless], range 0 to 15
 * @param mode_held  mode that holds in this step; [dimensionless], range 0 to 2
 * @param damping_Nms_rad  damping added to what is wanted; [Nm s/rad], range 0 to 0.350349993
 * @param given_J  energy given beyond the wanted torque's; [J], range 0 to 120.119995
 * @param held_J  that, and what drive and command may still give; [J], range 0 to 173.559555
 * @param adapted_gain  model's torque over the true one; [dimensionless], range 0.769230723 to 1.42857134
 * @param adapted_loss  stop operator's share in the model's torque; [dimensionless], range -0.399999976 to 0.399999976
 * @param adapted_offset_Nm  what the model shows without torque; [Nm], range -0.299999982 to 0.299999982
 * @param encoder_motor_status  what is known of this sample; bits below
 * @param encoder_load_status  what is known of this sample; bits below
 * @param joint_status  what is known of this sample; bits below
 * @param velocity_status  what is known of this sample; bits below
 * @param sensor_status  what is known of this sample; bits below
 * @param motor_rate_status  what is known of this sample; bits below
 * @param load_rate_status  what is known of this sample; bits below
 * @param encoder_gear_status  what is known of this sample; bits below
 * @param adaptation_status  what is known of it; bits below
 * @param reference_status  what is known of this set torque; bits below
 * @param passivity_status  what is known of this step; bits below
 * @param lead_status  what is known of it; bits below
 * @param inverse_status  what is known of this set-point; bits below
 * @param setpoint_status  what is known of this set-point; bits below
 * @param smooth_status  what is known of it; bits below
 * @param limits_status  which limits act, and what holds the latch; bits below
 * @param drive_status  what is known of this estimate; bits below
 * @param gear_status  what is known of this estimate; bits below
 * @param human_status  what is known of this estimate; bits below
 * @param set_rate_status  what is known of this sample; bits below
 * @param step_ticks  Timer ticks of the step, measuring included (empty_ticks).
 * @return length of the message in bytes (excluding serial stream start sign)
 */
static inline uint16_t mavlink_msg_esea_sense_out_pack(uint8_t system_id, uint8_t component_id, mavlink_message_t* msg,
                               uint32_t sequence, float u_Nm, float tau_Nm, float tau_set_Nm, float theta_rad, float theta_motor_rad, float theta_load_rad, float omega_motor_rad_s, float omega_load_rad_s, float delta_set_rad, float tau_h_Nm, float d4_rad_s2, float energy_J, float fault, float mode_held, float damping_Nms_rad, float given_J, float held_J, float adapted_gain, float adapted_loss, float adapted_offset_Nm, uint32_t encoder_motor_status, uint32_t encoder_load_status, uint32_t joint_status, uint32_t velocity_status, uint32_t sensor_status, uint32_t motor_rate_status, uint32_t load_rate_status, uint32_t encoder_gear_status, uint32_t adaptation_status, uint32_t reference_status, uint32_t passivity_status, uint32_t lead_status, uint32_t inverse_status, uint32_t setpoint_status, uint32_t smooth_status, uint32_t limits_status, uint32_t drive_status, uint32_t gear_status, uint32_t human_status, uint32_t set_rate_status, uint32_t step_ticks)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    char buf[MAVLINK_MSG_ID_ESEA_SENSE_OUT_LEN];
    _mav_put_uint32_t(buf, 0, sequence);
    _mav_put_float(buf, 4, u_Nm);
    _mav_put_float(buf, 8, tau_Nm);
    _mav_put_float(buf, 12, tau_set_Nm);
    _mav_put_float(buf, 16, theta_rad);
    _mav_put_float(buf, 20, theta_motor_rad);
    _mav_put_float(buf, 24, theta_load_rad);
    _mav_put_float(buf, 28, omega_motor_rad_s);
    _mav_put_float(buf, 32, omega_load_rad_s);
    _mav_put_float(buf, 36, delta_set_rad);
    _mav_put_float(buf, 40, tau_h_Nm);
    _mav_put_float(buf, 44, d4_rad_s2);
    _mav_put_float(buf, 48, energy_J);
    _mav_put_float(buf, 52, fault);
    _mav_put_float(buf, 56, mode_held);
    _mav_put_float(buf, 60, damping_Nms_rad);
    _mav_put_float(buf, 64, given_J);
    _mav_put_float(buf, 68, held_J);
    _mav_put_float(buf, 72, adapted_gain);
    _mav_put_float(buf, 76, adapted_loss);
    _mav_put_float(buf, 80, adapted_offset_Nm);
    _mav_put_uint32_t(buf, 84, encoder_motor_status);
    _mav_put_uint32_t(buf, 88, encoder_load_status);
    _mav_put_uint32_t(buf, 92, joint_status);
    _mav_put_uint32_t(buf, 96, velocity_status);
    _mav_put_uint32_t(buf, 100, sensor_status);
    _mav_put_uint32_t(buf, 104, motor_rate_status);
    _mav_put_uint32_t(buf, 108, load_rate_status);
    _mav_put_uint32_t(buf, 112, encoder_gear_status);
    _mav_put_uint32_t(buf, 116, adaptation_status);
    _mav_put_uint32_t(buf, 120, reference_status);
    _mav_put_uint32_t(buf, 124, passivity_status);
    _mav_put_uint32_t(buf, 128, lead_status);
    _mav_put_uint32_t(buf, 132, inverse_status);
    _mav_put_uint32_t(buf, 136, setpoint_status);
    _mav_put_uint32_t(buf, 140, smooth_status);
    _mav_put_uint32_t(buf, 144, limits_status);
    _mav_put_uint32_t(buf, 148, drive_status);
    _mav_put_uint32_t(buf, 152, gear_status);
    _mav_put_uint32_t(buf, 156, human_status);
    _mav_put_uint32_t(buf, 160, set_rate_status);
    _mav_put_uint32_t(buf, 164, step_ticks);

        memcpy(_MAV_PAYLOAD_NON_CONST(msg), buf, MAVLINK_MSG_ID_ESEA_SENSE_OUT_LEN);
#else
    mavlink_esea_sense_out_t packet;
    packet.sequence = sequence;
    packet.u_Nm = u_Nm;
    packet.tau_Nm = tau_Nm;
    packet.tau_set_Nm = tau_set_Nm;
    packet.theta_rad = theta_rad;
    packet.theta_motor_rad = theta_motor_rad;
    packet.theta_load_rad = theta_load_rad;
    packet.omega_motor_rad_s = omega_motor_rad_s;
    packet.omega_load_rad_s = omega_load_rad_s;
    packet.delta_set_rad = delta_set_rad;
    packet.tau_h_Nm = tau_h_Nm;
    packet.d4_rad_s2 = d4_rad_s2;
    packet.energy_J = energy_J;
    packet.fault = fault;
    packet.mode_held = mode_held;
    packet.damping_Nms_rad = damping_Nms_rad;
    packet.given_J = given_J;
    packet.held_J = held_J;
    packet.adapted_gain = adapted_gain;
    packet.adapted_loss = adapted_loss;
    packet.adapted_offset_Nm = adapted_offset_Nm;
    packet.encoder_motor_status = encoder_motor_status;
    packet.encoder_load_status = encoder_load_status;
    packet.joint_status = joint_status;
    packet.velocity_status = velocity_status;
    packet.sensor_status = sensor_status;
    packet.motor_rate_status = motor_rate_status;
    packet.load_rate_status = load_rate_status;
    packet.encoder_gear_status = encoder_gear_status;
    packet.adaptation_status = adaptation_status;
    packet.reference_status = reference_status;
    packet.passivity_status = passivity_status;
    packet.lead_status = lead_status;
    packet.inverse_status = inverse_status;
    packet.setpoint_status = setpoint_status;
    packet.smooth_status = smooth_status;
    packet.limits_status = limits_status;
    packet.drive_status = drive_status;
    packet.gear_status = gear_status;
    packet.human_status = human_status;
    packet.set_rate_status = set_rate_status;
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
 * @param u_Nm  motor torque, at the motor shaft; [Nm], range -0.220999986 to 0.220999986
 * @param tau_Nm  interaction torque on the load; [Nm], range -20 to 20; eq. (3.1)
 * @param tau_set_Nm  set torque, for the inverse; [Nm], range -4.46999979 to 4.46999979
 * @param theta_rad [rad] deflection: motor side minus load side; [rad], range -0.349999994 to 0.349999994
 * @param theta_motor_rad [rad] joint angle, motor or load side of the coupling; held, at first at count 0, while the encoder is not usable; [rad], range -35 to 35
 * @param theta_load_rad [rad] joint angle, motor or load side of the coupling; held, at first at count 0, while the encoder is not usable; [rad], range -35 to 35
 * @param omega_motor_rad_s [rad/s] filtered rate of the angle; [rad/s], range -12 to 12
 * @param omega_load_rad_s [rad/s] filtered rate of the angle; [rad/s], range -12 to 12
 * @param delta_set_rad [rad] deflection set-point; [rad], range -0.349999994 to 0.349999994
 * @param tau_h_Nm  torque of the person; [Nm], range -20 to 20
 * @param d4_rad_s2  disturbance of the drive; [rad/s^2], range -24.666666 to 24.666666; eq. (5.5)
 * @param energy_J  energy given to the limb within the window; [J], range 0 to 269.306396
 * @param fault  first reason of the latch, one of the FAULT numbers; 0 when released; [dimensionless], range 0 to 15
 * @param mode_held  mode that holds in this step; [dimensionless], range 0 to 2
 * @param damping_Nms_rad  damping added to what is wanted; [Nm s/rad], range 0 to 0.350349993
 * @param given_J  energy given beyond the wanted torque's; [J], range 0 to 120.119995
 * @param held_J  that, and what drive and command may still give; [J], range 0 to 173.559555
 * @param adapted_gain  model's torque over the true one; [dimensionless], range 0.769230723 to 1.42857134
 * @param adapted_loss  stop operator's share in the model's torque; [dimensionless], range -0.399999976 to 0.399999976
 * @param adapted_offset_Nm  what the model shows without torque; [Nm], range -0.299999982 to 0.299999982
 * @param encoder_motor_status  what is known of this sample; bits below
 * @param encoder_load_status  what is known of this sample; bits below
 * @param joint_status  what is known of this sample; bits below
 * @param velocity_status  what is known of this sample; bits below
 * @param sensor_status  what is known of this sample; bits below
 * @param motor_rate_status  what is known of this sample; bits below
 * @param load_rate_status  what is known of this sample; bits below
 * @param encoder_gear_status  what is known of this sample; bits below
 * @param adaptation_status  what is known of it; bits below
 * @param reference_status  what is known of this set torque; bits below
 * @param passivity_status  what is known of this step; bits below
 * @param lead_status  what is known of it; bits below
 * @param inverse_status  what is known of this set-point; bits below
 * @param setpoint_status  what is known of this set-point; bits below
 * @param smooth_status  what is known of it; bits below
 * @param limits_status  which limits act, and what holds the latch; bits below
 * @param drive_status  what is known of this estimate; bits below
 * @param gear_status  what is known of this estimate; bits below
 * @param human_status  what is known of this estimate; bits below
 * @param set_rate_status  what is known of this sample; bits below
 * @param step_ticks  Timer ticks of the step, measuring included (empty_ticks).
 * @return length of the message in bytes (excluding serial stream start sign)
 */
static inline uint16_t mavlink_msg_esea_sense_out_pack_status(uint8_t system_id, uint8_t component_id, mavlink_status_t *_status, mavlink_message_t* msg,
                               uint32_t sequence, float u_Nm, float tau_Nm, float tau_set_Nm, float theta_rad, float theta_motor_rad, float theta_load_rad, float omega_motor_rad_s, float omega_load_rad_s, float delta_set_rad, float tau_h_Nm, float d4_rad_s2, float energy_J, float fault, float mode_held, float damping_Nms_rad, float given_J, float held_J, float adapted_gain, float adapted_loss, float adapted_offset_Nm, uint32_t encoder_motor_status, uint32_t encoder_load_status, uint32_t joint_status, uint32_t velocity_status, uint32_t sensor_status, uint32_t motor_rate_status, uint32_t load_rate_status, uint32_t encoder_gear_status, uint32_t adaptation_status, uint32_t reference_status, uint32_t passivity_status, uint32_t lead_status, uint32_t inverse_status, uint32_t setpoint_status, uint32_t smooth_status, uint32_t limits_status, uint32_t drive_status, uint32_t gear_status, uint32_t human_status, uint32_t set_rate_status, uint32_t step_ticks)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    char buf[MAVLINK_MSG_ID_ESEA_SENSE_OUT_LEN];
    _mav_put_uint32_t(buf, 0, sequence);
    _mav_put_float(buf, 4, u_Nm);
    _mav_put_float(buf, 8, tau_Nm);
    _mav_put_float(buf, 12, tau_set_Nm);
    _mav_put_float(buf, 16, theta_rad);
    _mav_put_float(buf, 20, theta_motor_rad);
    _mav_put_float(buf, 24, theta_load_rad);
    _mav_put_float(buf, 28, omega_motor_rad_s);
    _mav_put_float(buf, 32, omega_load_rad_s);
    _mav_put_float(buf, 36, delta_set_rad);
    _mav_put_float(buf, 40, tau_h_Nm);
    _mav_put_float(buf, 44, d4_rad_s2);
    _mav_put_float(buf, 48, energy_J);
    _mav_put_float(buf, 52, fault);
    _mav_put_float(buf, 56, mode_held);
    _mav_put_float(buf, 60, damping_Nms_rad);
    _mav_put_float(buf, 64, given_J);
    _mav_put_float(buf, 68, held_J);
    _mav_put_float(buf, 72, adapted_gain);
    _mav_put_float(buf, 76, adapted_loss);
    _mav_put_float(buf, 80, adapted_offset_Nm);
    _mav_put_uint32_t(buf, 84, encoder_motor_status);
    _mav_put_uint32_t(buf, 88, encoder_load_status);
    _mav_put_uint32_t(buf, 92, joint_status);
    _mav_put_uint32_t(buf, 96, velocity_status);
    _mav_put_uint32_t(buf, 100, sensor_status);
    _mav_put_uint32_t(buf, 104, motor_rate_status);
    _mav_put_uint32_t(buf, 108, load_rate_status);
    _mav_put_uint32_t(buf, 112, encoder_gear_status);
    _mav_put_uint32_t(buf, 116, adaptation_status);
    _mav_put_uint32_t(buf, 120, reference_status);
    _mav_put_uint32_t(buf, 124, passivity_status);
    _mav_put_uint32_t(buf, 128, lead_status);
    _mav_put_uint32_t(buf, 132, inverse_status);
    _mav_put_uint32_t(buf, 136, setpoint_status);
    _mav_put_uint32_t(buf, 140, smooth_status);
    _mav_put_uint32_t(buf, 144, limits_status);
    _mav_put_uint32_t(buf, 148, drive_status);
    _mav_put_uint32_t(buf, 152, gear_status);
    _mav_put_uint32_t(buf, 156, human_status);
    _mav_put_uint32_t(buf, 160, set_rate_status);
    _mav_put_uint32_t(buf, 164, step_ticks);

        memcpy(_MAV_PAYLOAD_NON_CONST(msg), buf, MAVLINK_MSG_ID_ESEA_SENSE_OUT_LEN);
#else
    mavlink_esea_sense_out_t packet;
    packet.sequence = sequence;
    packet.u_Nm = u_Nm;
    packet.tau_Nm = tau_Nm;
    packet.tau_set_Nm = tau_set_Nm;
    packet.theta_rad = theta_rad;
    packet.theta_motor_rad = theta_motor_rad;
    packet.theta_load_rad = theta_load_rad;
    packet.omega_motor_rad_s = omega_motor_rad_s;
    packet.omega_load_rad_s = omega_load_rad_s;
    packet.delta_set_rad = delta_set_rad;
    packet.tau_h_Nm = tau_h_Nm;
    packet.d4_rad_s2 = d4_rad_s2;
    packet.energy_J = energy_J;
    packet.fault = fault;
    packet.mode_held = mode_held;
    packet.damping_Nms_rad = damping_Nms_rad;
    packet.given_J = given_J;
    packet.held_J = held_J;
    packet.adapted_gain = adapted_gain;
    packet.adapted_loss = adapted_loss;
    packet.adapted_offset_Nm = adapted_offset_Nm;
    packet.encoder_motor_status = encoder_motor_status;
    packet.encoder_load_status = encoder_load_status;
    packet.joint_status = joint_status;
    packet.velocity_status = velocity_status;
    packet.sensor_status = sensor_status;
    packet.motor_rate_status = motor_rate_status;
    packet.load_rate_status = load_rate_status;
    packet.encoder_gear_status = encoder_gear_status;
    packet.adaptation_status = adaptation_status;
    packet.reference_status = reference_status;
    packet.passivity_status = passivity_status;
    packet.lead_status = lead_status;
    packet.inverse_status = inverse_status;
    packet.setpoint_status = setpoint_status;
    packet.smooth_status = smooth_status;
    packet.limits_status = limits_status;
    packet.drive_status = drive_status;
    packet.gear_status = gear_status;
    packet.human_status = human_status;
    packet.set_rate_status = set_rate_status;
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
 * @param u_Nm  motor torque, at the motor shaft; [Nm], range -0.220999986 to 0.220999986
 * @param tau_Nm  interaction torque on the load; [Nm], range -20 to 20; eq. (3.1)
 * @param tau_set_Nm  set torque, for the inverse; [Nm], range -4.46999979 to 4.46999979
 * @param theta_rad [rad] deflection: motor side minus load side; [rad], range -0.349999994 to 0.349999994
 * @param theta_motor_rad [rad] joint angle, motor or load side of the coupling; held, at first at count 0, while the encoder is not usable; [rad], range -35 to 35
 * @param theta_load_rad [rad] joint angle, motor or load side of the coupling; held, at first at count 0, while the encoder is not usable; [rad], range -35 to 35
 * @param omega_motor_rad_s [rad/s] filtered rate of the angle; [rad/s], range -12 to 12
 * @param omega_load_rad_s [rad/s] filtered rate of the angle; [rad/s], range -12 to 12
 * @param delta_set_rad [rad] deflection set-point; [rad], range -0.349999994 to 0.349999994
 * @param tau_h_Nm  torque of the person; [Nm], range -20 to 20
 * @param d4_rad_s2  disturbance of the drive; [rad/s^2], range -24.666666 to 24.666666; eq. (5.5)
 * @param energy_J  energy given to the limb within the window; [J], range 0 to 269.306396
 * @param fault  first reason of the latch, one of the FAULT numbers; 0 when released; [dimensionless], range 0 to 15
 * @param mode_held  mode that holds in this step; [dimensionless], range 0 to 2
 * @param damping_Nms_rad  damping added to what is wanted; [Nm s/rad], range 0 to 0.350349993
 * @param given_J  energy given beyond the wanted torque's; [J], range 0 to 120.119995
 * @param held_J  that, and what drive and command may still give; [J], range 0 to 173.559555
 * @param adapted_gain  model's torque over the true one; [dimensionless], range 0.769230723 to 1.42857134
 * @param adapted_loss  stop operator's share in the model's torque; [dimensionless], range -0.399999976 to 0.399999976
 * @param adapted_offset_Nm  what the model shows without torque; [Nm], range -0.299999982 to 0.299999982
 * @param encoder_motor_status  what is known of this sample; bits below
 * @param encoder_load_status  what is known of this sample; bits below
 * @param joint_status  what is known of this sample; bits below
 * @param velocity_status  what is known of this sample; bits below
 * @param sensor_status  what is known of this sample; bits below
 * @param motor_rate_status  what is known of this sample; bits below
 * @param load_rate_status  what is known of this sample; bits below
 * @param encoder_gear_status  what is known of this sample; bits below
 * @param adaptation_status  what is known of it; bits below
 * @param reference_status  what is known of this set torque; bits below
 * @param passivity_status  what is known of this step; bits below
 * @param lead_status  what is known of it; bits below
 * @param inverse_status  what is known of this set-point; bits below
 * @param setpoint_status  what is known of this set-point; bits below
 * @param smooth_status  what is known of it; bits below
 * @param limits_status  which limits act, and what holds the latch; bits below
 * @param drive_status  what is known of this estimate; bits below
 * @param gear_status  what is known of this estimate; bits below
 * @param human_status  what is known of this estimate; bits below
 * @param set_rate_status  what is known of this sample; bits below
 * @param step_ticks  Timer ticks of the step, measuring included (empty_ticks).
 * @return length of the message in bytes (excluding serial stream start sign)
 */
static inline uint16_t mavlink_msg_esea_sense_out_pack_chan(uint8_t system_id, uint8_t component_id, uint8_t chan,
                               mavlink_message_t* msg,
                                   uint32_t sequence,float u_Nm,float tau_Nm,float tau_set_Nm,float theta_rad,float theta_motor_rad,float theta_load_rad,float omega_motor_rad_s,float omega_load_rad_s,float delta_set_rad,float tau_h_Nm,float d4_rad_s2,float energy_J,float fault,float mode_held,float damping_Nms_rad,float given_J,float held_J,float adapted_gain,float adapted_loss,float adapted_offset_Nm,uint32_t encoder_motor_status,uint32_t encoder_load_status,uint32_t joint_status,uint32_t velocity_status,uint32_t sensor_status,uint32_t motor_rate_status,uint32_t load_rate_status,uint32_t encoder_gear_status,uint32_t adaptation_status,uint32_t reference_status,uint32_t passivity_status,uint32_t lead_status,uint32_t inverse_status,uint32_t setpoint_status,uint32_t smooth_status,uint32_t limits_status,uint32_t drive_status,uint32_t gear_status,uint32_t human_status,uint32_t set_rate_status,uint32_t step_ticks)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    char buf[MAVLINK_MSG_ID_ESEA_SENSE_OUT_LEN];
    _mav_put_uint32_t(buf, 0, sequence);
    _mav_put_float(buf, 4, u_Nm);
    _mav_put_float(buf, 8, tau_Nm);
    _mav_put_float(buf, 12, tau_set_Nm);
    _mav_put_float(buf, 16, theta_rad);
    _mav_put_float(buf, 20, theta_motor_rad);
    _mav_put_float(buf, 24, theta_load_rad);
    _mav_put_float(buf, 28, omega_motor_rad_s);
    _mav_put_float(buf, 32, omega_load_rad_s);
    _mav_put_float(buf, 36, delta_set_rad);
    _mav_put_float(buf, 40, tau_h_Nm);
    _mav_put_float(buf, 44, d4_rad_s2);
    _mav_put_float(buf, 48, energy_J);
    _mav_put_float(buf, 52, fault);
    _mav_put_float(buf, 56, mode_held);
    _mav_put_float(buf, 60, damping_Nms_rad);
    _mav_put_float(buf, 64, given_J);
    _mav_put_float(buf, 68, held_J);
    _mav_put_float(buf, 72, adapted_gain);
    _mav_put_float(buf, 76, adapted_loss);
    _mav_put_float(buf, 80, adapted_offset_Nm);
    _mav_put_uint32_t(buf, 84, encoder_motor_status);
    _mav_put_uint32_t(buf, 88, encoder_load_status);
    _mav_put_uint32_t(buf, 92, joint_status);
    _mav_put_uint32_t(buf, 96, velocity_status);
    _mav_put_uint32_t(buf, 100, sensor_status);
    _mav_put_uint32_t(buf, 104, motor_rate_status);
    _mav_put_uint32_t(buf, 108, load_rate_status);
    _mav_put_uint32_t(buf, 112, encoder_gear_status);
    _mav_put_uint32_t(buf, 116, adaptation_status);
    _mav_put_uint32_t(buf, 120, reference_status);
    _mav_put_uint32_t(buf, 124, passivity_status);
    _mav_put_uint32_t(buf, 128, lead_status);
    _mav_put_uint32_t(buf, 132, inverse_status);
    _mav_put_uint32_t(buf, 136, setpoint_status);
    _mav_put_uint32_t(buf, 140, smooth_status);
    _mav_put_uint32_t(buf, 144, limits_status);
    _mav_put_uint32_t(buf, 148, drive_status);
    _mav_put_uint32_t(buf, 152, gear_status);
    _mav_put_uint32_t(buf, 156, human_status);
    _mav_put_uint32_t(buf, 160, set_rate_status);
    _mav_put_uint32_t(buf, 164, step_ticks);

        memcpy(_MAV_PAYLOAD_NON_CONST(msg), buf, MAVLINK_MSG_ID_ESEA_SENSE_OUT_LEN);
#else
    mavlink_esea_sense_out_t packet;
    packet.sequence = sequence;
    packet.u_Nm = u_Nm;
    packet.tau_Nm = tau_Nm;
    packet.tau_set_Nm = tau_set_Nm;
    packet.theta_rad = theta_rad;
    packet.theta_motor_rad = theta_motor_rad;
    packet.theta_load_rad = theta_load_rad;
    packet.omega_motor_rad_s = omega_motor_rad_s;
    packet.omega_load_rad_s = omega_load_rad_s;
    packet.delta_set_rad = delta_set_rad;
    packet.tau_h_Nm = tau_h_Nm;
    packet.d4_rad_s2 = d4_rad_s2;
    packet.energy_J = energy_J;
    packet.fault = fault;
    packet.mode_held = mode_held;
    packet.damping_Nms_rad = damping_Nms_rad;
    packet.given_J = given_J;
    packet.held_J = held_J;
    packet.adapted_gain = adapted_gain;
    packet.adapted_loss = adapted_loss;
    packet.adapted_offset_Nm = adapted_offset_Nm;
    packet.encoder_motor_status = encoder_motor_status;
    packet.encoder_load_status = encoder_load_status;
    packet.joint_status = joint_status;
    packet.velocity_status = velocity_status;
    packet.sensor_status = sensor_status;
    packet.motor_rate_status = motor_rate_status;
    packet.load_rate_status = load_rate_status;
    packet.encoder_gear_status = encoder_gear_status;
    packet.adaptation_status = adaptation_status;
    packet.reference_status = reference_status;
    packet.passivity_status = passivity_status;
    packet.lead_status = lead_status;
    packet.inverse_status = inverse_status;
    packet.setpoint_status = setpoint_status;
    packet.smooth_status = smooth_status;
    packet.limits_status = limits_status;
    packet.drive_status = drive_status;
    packet.gear_status = gear_status;
    packet.human_status = human_status;
    packet.set_rate_status = set_rate_status;
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
    return mavlink_msg_esea_sense_out_pack(system_id, component_id, msg, esea_sense_out->sequence, esea_sense_out->u_Nm, esea_sense_out->tau_Nm, esea_sense_out->tau_set_Nm, esea_sense_out->theta_rad, esea_sense_out->theta_motor_rad, esea_sense_out->theta_load_rad, esea_sense_out->omega_motor_rad_s, esea_sense_out->omega_load_rad_s, esea_sense_out->delta_set_rad, esea_sense_out->tau_h_Nm, esea_sense_out->d4_rad_s2, esea_sense_out->energy_J, esea_sense_out->fault, esea_sense_out->mode_held, esea_sense_out->damping_Nms_rad, esea_sense_out->given_J, esea_sense_out->held_J, esea_sense_out->adapted_gain, esea_sense_out->adapted_loss, esea_sense_out->adapted_offset_Nm, esea_sense_out->encoder_motor_status, esea_sense_out->encoder_load_status, esea_sense_out->joint_status, esea_sense_out->velocity_status, esea_sense_out->sensor_status, esea_sense_out->motor_rate_status, esea_sense_out->load_rate_status, esea_sense_out->encoder_gear_status, esea_sense_out->adaptation_status, esea_sense_out->reference_status, esea_sense_out->passivity_status, esea_sense_out->lead_status, esea_sense_out->inverse_status, esea_sense_out->setpoint_status, esea_sense_out->smooth_status, esea_sense_out->limits_status, esea_sense_out->drive_status, esea_sense_out->gear_status, esea_sense_out->human_status, esea_sense_out->set_rate_status, esea_sense_out->step_ticks);
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
    return mavlink_msg_esea_sense_out_pack_chan(system_id, component_id, chan, msg, esea_sense_out->sequence, esea_sense_out->u_Nm, esea_sense_out->tau_Nm, esea_sense_out->tau_set_Nm, esea_sense_out->theta_rad, esea_sense_out->theta_motor_rad, esea_sense_out->theta_load_rad, esea_sense_out->omega_motor_rad_s, esea_sense_out->omega_load_rad_s, esea_sense_out->delta_set_rad, esea_sense_out->tau_h_Nm, esea_sense_out->d4_rad_s2, esea_sense_out->energy_J, esea_sense_out->fault, esea_sense_out->mode_held, esea_sense_out->damping_Nms_rad, esea_sense_out->given_J, esea_sense_out->held_J, esea_sense_out->adapted_gain, esea_sense_out->adapted_loss, esea_sense_out->adapted_offset_Nm, esea_sense_out->encoder_motor_status, esea_sense_out->encoder_load_status, esea_sense_out->joint_status, esea_sense_out->velocity_status, esea_sense_out->sensor_status, esea_sense_out->motor_rate_status, esea_sense_out->load_rate_status, esea_sense_out->encoder_gear_status, esea_sense_out->adaptation_status, esea_sense_out->reference_status, esea_sense_out->passivity_status, esea_sense_out->lead_status, esea_sense_out->inverse_status, esea_sense_out->setpoint_status, esea_sense_out->smooth_status, esea_sense_out->limits_status, esea_sense_out->drive_status, esea_sense_out->gear_status, esea_sense_out->human_status, esea_sense_out->set_rate_status, esea_sense_out->step_ticks);
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
    return mavlink_msg_esea_sense_out_pack_status(system_id, component_id, _status, msg,  esea_sense_out->sequence, esea_sense_out->u_Nm, esea_sense_out->tau_Nm, esea_sense_out->tau_set_Nm, esea_sense_out->theta_rad, esea_sense_out->theta_motor_rad, esea_sense_out->theta_load_rad, esea_sense_out->omega_motor_rad_s, esea_sense_out->omega_load_rad_s, esea_sense_out->delta_set_rad, esea_sense_out->tau_h_Nm, esea_sense_out->d4_rad_s2, esea_sense_out->energy_J, esea_sense_out->fault, esea_sense_out->mode_held, esea_sense_out->damping_Nms_rad, esea_sense_out->given_J, esea_sense_out->held_J, esea_sense_out->adapted_gain, esea_sense_out->adapted_loss, esea_sense_out->adapted_offset_Nm, esea_sense_out->encoder_motor_status, esea_sense_out->encoder_load_status, esea_sense_out->joint_status, esea_sense_out->velocity_status, esea_sense_out->sensor_status, esea_sense_out->motor_rate_status, esea_sense_out->load_rate_status, esea_sense_out->encoder_gear_status, esea_sense_out->adaptation_status, esea_sense_out->reference_status, esea_sense_out->passivity_status, esea_sense_out->lead_status, esea_sense_out->inverse_status, esea_sense_out->setpoint_status, esea_sense_out->smooth_status, esea_sense_out->limits_status, esea_sense_out->drive_status, esea_sense_out->gear_status, esea_sense_out->human_status, esea_sense_out->set_rate_status, esea_sense_out->step_ticks);
}

/**
 * @brief Send a esea_sense_out message
 * @param chan MAVLink channel to send the message
 *
 * @param sequence  Base tick of this run of the task.
 * @param u_Nm  motor torque, at the motor shaft; [Nm], range -0.220999986 to 0.220999986
 * @param tau_Nm  interaction torque on the load; [Nm], range -20 to 20; eq. (3.1)
 * @param tau_set_Nm  set torque, for the inverse; [Nm], range -4.46999979 to 4.46999979
 * @param theta_rad [rad] deflection: motor side minus load side; [rad], range -0.349999994 to 0.349999994
 * @param theta_motor_rad [rad] joint angle, motor or load side of the coupling; held, at first at count 0, while the encoder is not usable; [rad], range -35 to 35
 * @param theta_load_rad [rad] joint angle, motor or load side of the coupling; held, at first at count 0, while the encoder is not usable; [rad], range -35 to 35
 * @param omega_motor_rad_s [rad/s] filtered rate of the angle; [rad/s], range -12 to 12
 * @param omega_load_rad_s [rad/s] filtered rate of the angle; [rad/s], range -12 to 12
 * @param delta_set_rad [rad] deflection set-point; [rad], range -0.349999994 to 0.349999994
 * @param tau_h_Nm  torque of the person; [Nm], range -20 to 20
 * @param d4_rad_s2  disturbance of the drive; [rad/s^2], range -24.666666 to 24.666666; eq. (5.5)
 * @param energy_J  energy given to the limb within the window; [J], range 0 to 269.306396
 * @param fault  first reason of the latch, one of the FAULT numbers; 0 when released; [dimensionless], range 0 to 15
 * @param mode_held  mode that holds in this step; [dimensionless], range 0 to 2
 * @param damping_Nms_rad  damping added to what is wanted; [Nm s/rad], range 0 to 0.350349993
 * @param given_J  energy given beyond the wanted torque's; [J], range 0 to 120.119995
 * @param held_J  that, and what drive and command may still give; [J], range 0 to 173.559555
 * @param adapted_gain  model's torque over the true one; [dimensionless], range 0.769230723 to 1.42857134
 * @param adapted_loss  stop operator's share in the model's torque; [dimensionless], range -0.399999976 to 0.399999976
 * @param adapted_offset_Nm  what the model shows without torque; [Nm], range -0.299999982 to 0.299999982
 * @param encoder_motor_status  what is known of this sample; bits below
 * @param encoder_load_status  what is known of this sample; bits below
 * @param joint_status  what is known of this sample; bits below
 * @param velocity_status  what is known of this sample; bits below
 * @param sensor_status  what is known of this sample; bits below
 * @param motor_rate_status  what is known of this sample; bits below
 * @param load_rate_status  what is known of this sample; bits below
 * @param encoder_gear_status  what is known of this sample; bits below
 * @param adaptation_status  what is known of it; bits below
 * @param reference_status  what is known of this set torque; bits below
 * @param passivity_status  what is known of this step; bits below
 * @param lead_status  what is known of it; bits below
 * @param inverse_status  what is known of this set-point; bits below
 * @param setpoint_status  what is known of this set-point; bits below
 * @param smooth_status  what is known of it; bits below
 * @param limits_status  which limits act, and what holds the latch; bits below
 * @param drive_status  what is known of this estimate; bits below
 * @param gear_status  what is known of this estimate; bits below
 * @param human_status  what is known of this estimate; bits below
 * @param set_rate_status  what is known of this sample; bits below
 * @param step_ticks  Timer ticks of the step, measuring included (empty_ticks).
 */
#ifdef MAVLINK_USE_CONVENIENCE_FUNCTIONS

static inline void mavlink_msg_esea_sense_out_send(mavlink_channel_t chan, uint32_t sequence, float u_Nm, float tau_Nm, float tau_set_Nm, float theta_rad, float theta_motor_rad, float theta_load_rad, float omega_motor_rad_s, float omega_load_rad_s, float delta_set_rad, float tau_h_Nm, float d4_rad_s2, float energy_J, float fault, float mode_held, float damping_Nms_rad, float given_J, float held_J, float adapted_gain, float adapted_loss, float adapted_offset_Nm, uint32_t encoder_motor_status, uint32_t encoder_load_status, uint32_t joint_status, uint32_t velocity_status, uint32_t sensor_status, uint32_t motor_rate_status, uint32_t load_rate_status, uint32_t encoder_gear_status, uint32_t adaptation_status, uint32_t reference_status, uint32_t passivity_status, uint32_t lead_status, uint32_t inverse_status, uint32_t setpoint_status, uint32_t smooth_status, uint32_t limits_status, uint32_t drive_status, uint32_t gear_status, uint32_t human_status, uint32_t set_rate_status, uint32_t step_ticks)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    char buf[MAVLINK_MSG_ID_ESEA_SENSE_OUT_LEN];
    _mav_put_uint32_t(buf, 0, sequence);
    _mav_put_float(buf, 4, u_Nm);
    _mav_put_float(buf, 8, tau_Nm);
    _mav_put_float(buf, 12, tau_set_Nm);
    _mav_put_float(buf, 16, theta_rad);
    _mav_put_float(buf, 20, theta_motor_rad);
    _mav_put_float(buf, 24, theta_load_rad);
    _mav_put_float(buf, 28, omega_motor_rad_s);
    _mav_put_float(buf, 32, omega_load_rad_s);
    _mav_put_float(buf, 36, delta_set_rad);
    _mav_put_float(buf, 40, tau_h_Nm);
    _mav_put_float(buf, 44, d4_rad_s2);
    _mav_put_float(buf, 48, energy_J);
    _mav_put_float(buf, 52, fault);
    _mav_put_float(buf, 56, mode_held);
    _mav_put_float(buf, 60, damping_Nms_rad);
    _mav_put_float(buf, 64, given_J);
    _mav_put_float(buf, 68, held_J);
    _mav_put_float(buf, 72, adapted_gain);
    _mav_put_float(buf, 76, adapted_loss);
    _mav_put_float(buf, 80, adapted_offset_Nm);
    _mav_put_uint32_t(buf, 84, encoder_motor_status);
    _mav_put_uint32_t(buf, 88, encoder_load_status);
    _mav_put_uint32_t(buf, 92, joint_status);
    _mav_put_uint32_t(buf, 96, velocity_status);
    _mav_put_uint32_t(buf, 100, sensor_status);
    _mav_put_uint32_t(buf, 104, motor_rate_status);
    _mav_put_uint32_t(buf, 108, load_rate_status);
    _mav_put_uint32_t(buf, 112, encoder_gear_status);
    _mav_put_uint32_t(buf, 116, adaptation_status);
    _mav_put_uint32_t(buf, 120, reference_status);
    _mav_put_uint32_t(buf, 124, passivity_status);
    _mav_put_uint32_t(buf, 128, lead_status);
    _mav_put_uint32_t(buf, 132, inverse_status);
    _mav_put_uint32_t(buf, 136, setpoint_status);
    _mav_put_uint32_t(buf, 140, smooth_status);
    _mav_put_uint32_t(buf, 144, limits_status);
    _mav_put_uint32_t(buf, 148, drive_status);
    _mav_put_uint32_t(buf, 152, gear_status);
    _mav_put_uint32_t(buf, 156, human_status);
    _mav_put_uint32_t(buf, 160, set_rate_status);
    _mav_put_uint32_t(buf, 164, step_ticks);

    _mav_finalize_message_chan_send(chan, MAVLINK_MSG_ID_ESEA_SENSE_OUT, buf, MAVLINK_MSG_ID_ESEA_SENSE_OUT_MIN_LEN, MAVLINK_MSG_ID_ESEA_SENSE_OUT_LEN, MAVLINK_MSG_ID_ESEA_SENSE_OUT_CRC);
#else
    mavlink_esea_sense_out_t packet;
    packet.sequence = sequence;
    packet.u_Nm = u_Nm;
    packet.tau_Nm = tau_Nm;
    packet.tau_set_Nm = tau_set_Nm;
    packet.theta_rad = theta_rad;
    packet.theta_motor_rad = theta_motor_rad;
    packet.theta_load_rad = theta_load_rad;
    packet.omega_motor_rad_s = omega_motor_rad_s;
    packet.omega_load_rad_s = omega_load_rad_s;
    packet.delta_set_rad = delta_set_rad;
    packet.tau_h_Nm = tau_h_Nm;
    packet.d4_rad_s2 = d4_rad_s2;
    packet.energy_J = energy_J;
    packet.fault = fault;
    packet.mode_held = mode_held;
    packet.damping_Nms_rad = damping_Nms_rad;
    packet.given_J = given_J;
    packet.held_J = held_J;
    packet.adapted_gain = adapted_gain;
    packet.adapted_loss = adapted_loss;
    packet.adapted_offset_Nm = adapted_offset_Nm;
    packet.encoder_motor_status = encoder_motor_status;
    packet.encoder_load_status = encoder_load_status;
    packet.joint_status = joint_status;
    packet.velocity_status = velocity_status;
    packet.sensor_status = sensor_status;
    packet.motor_rate_status = motor_rate_status;
    packet.load_rate_status = load_rate_status;
    packet.encoder_gear_status = encoder_gear_status;
    packet.adaptation_status = adaptation_status;
    packet.reference_status = reference_status;
    packet.passivity_status = passivity_status;
    packet.lead_status = lead_status;
    packet.inverse_status = inverse_status;
    packet.setpoint_status = setpoint_status;
    packet.smooth_status = smooth_status;
    packet.limits_status = limits_status;
    packet.drive_status = drive_status;
    packet.gear_status = gear_status;
    packet.human_status = human_status;
    packet.set_rate_status = set_rate_status;
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
    mavlink_msg_esea_sense_out_send(chan, esea_sense_out->sequence, esea_sense_out->u_Nm, esea_sense_out->tau_Nm, esea_sense_out->tau_set_Nm, esea_sense_out->theta_rad, esea_sense_out->theta_motor_rad, esea_sense_out->theta_load_rad, esea_sense_out->omega_motor_rad_s, esea_sense_out->omega_load_rad_s, esea_sense_out->delta_set_rad, esea_sense_out->tau_h_Nm, esea_sense_out->d4_rad_s2, esea_sense_out->energy_J, esea_sense_out->fault, esea_sense_out->mode_held, esea_sense_out->damping_Nms_rad, esea_sense_out->given_J, esea_sense_out->held_J, esea_sense_out->adapted_gain, esea_sense_out->adapted_loss, esea_sense_out->adapted_offset_Nm, esea_sense_out->encoder_motor_status, esea_sense_out->encoder_load_status, esea_sense_out->joint_status, esea_sense_out->velocity_status, esea_sense_out->sensor_status, esea_sense_out->motor_rate_status, esea_sense_out->load_rate_status, esea_sense_out->encoder_gear_status, esea_sense_out->adaptation_status, esea_sense_out->reference_status, esea_sense_out->passivity_status, esea_sense_out->lead_status, esea_sense_out->inverse_status, esea_sense_out->setpoint_status, esea_sense_out->smooth_status, esea_sense_out->limits_status, esea_sense_out->drive_status, esea_sense_out->gear_status, esea_sense_out->human_status, esea_sense_out->set_rate_status, esea_sense_out->step_ticks);
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
static inline void mavlink_msg_esea_sense_out_send_buf(mavlink_message_t *msgbuf, mavlink_channel_t chan,  uint32_t sequence, float u_Nm, float tau_Nm, float tau_set_Nm, float theta_rad, float theta_motor_rad, float theta_load_rad, float omega_motor_rad_s, float omega_load_rad_s, float delta_set_rad, float tau_h_Nm, float d4_rad_s2, float energy_J, float fault, float mode_held, float damping_Nms_rad, float given_J, float held_J, float adapted_gain, float adapted_loss, float adapted_offset_Nm, uint32_t encoder_motor_status, uint32_t encoder_load_status, uint32_t joint_status, uint32_t velocity_status, uint32_t sensor_status, uint32_t motor_rate_status, uint32_t load_rate_status, uint32_t encoder_gear_status, uint32_t adaptation_status, uint32_t reference_status, uint32_t passivity_status, uint32_t lead_status, uint32_t inverse_status, uint32_t setpoint_status, uint32_t smooth_status, uint32_t limits_status, uint32_t drive_status, uint32_t gear_status, uint32_t human_status, uint32_t set_rate_status, uint32_t step_ticks)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    char *buf = (char *)msgbuf;
    _mav_put_uint32_t(buf, 0, sequence);
    _mav_put_float(buf, 4, u_Nm);
    _mav_put_float(buf, 8, tau_Nm);
    _mav_put_float(buf, 12, tau_set_Nm);
    _mav_put_float(buf, 16, theta_rad);
    _mav_put_float(buf, 20, theta_motor_rad);
    _mav_put_float(buf, 24, theta_load_rad);
    _mav_put_float(buf, 28, omega_motor_rad_s);
    _mav_put_float(buf, 32, omega_load_rad_s);
    _mav_put_float(buf, 36, delta_set_rad);
    _mav_put_float(buf, 40, tau_h_Nm);
    _mav_put_float(buf, 44, d4_rad_s2);
    _mav_put_float(buf, 48, energy_J);
    _mav_put_float(buf, 52, fault);
    _mav_put_float(buf, 56, mode_held);
    _mav_put_float(buf, 60, damping_Nms_rad);
    _mav_put_float(buf, 64, given_J);
    _mav_put_float(buf, 68, held_J);
    _mav_put_float(buf, 72, adapted_gain);
    _mav_put_float(buf, 76, adapted_loss);
    _mav_put_float(buf, 80, adapted_offset_Nm);
    _mav_put_uint32_t(buf, 84, encoder_motor_status);
    _mav_put_uint32_t(buf, 88, encoder_load_status);
    _mav_put_uint32_t(buf, 92, joint_status);
    _mav_put_uint32_t(buf, 96, velocity_status);
    _mav_put_uint32_t(buf, 100, sensor_status);
    _mav_put_uint32_t(buf, 104, motor_rate_status);
    _mav_put_uint32_t(buf, 108, load_rate_status);
    _mav_put_uint32_t(buf, 112, encoder_gear_status);
    _mav_put_uint32_t(buf, 116, adaptation_status);
    _mav_put_uint32_t(buf, 120, reference_status);
    _mav_put_uint32_t(buf, 124, passivity_status);
    _mav_put_uint32_t(buf, 128, lead_status);
    _mav_put_uint32_t(buf, 132, inverse_status);
    _mav_put_uint32_t(buf, 136, setpoint_status);
    _mav_put_uint32_t(buf, 140, smooth_status);
    _mav_put_uint32_t(buf, 144, limits_status);
    _mav_put_uint32_t(buf, 148, drive_status);
    _mav_put_uint32_t(buf, 152, gear_status);
    _mav_put_uint32_t(buf, 156, human_status);
    _mav_put_uint32_t(buf, 160, set_rate_status);
    _mav_put_uint32_t(buf, 164, step_ticks);

    _mav_finalize_message_chan_send(chan, MAVLINK_MSG_ID_ESEA_SENSE_OUT, buf, MAVLINK_MSG_ID_ESEA_SENSE_OUT_MIN_LEN, MAVLINK_MSG_ID_ESEA_SENSE_OUT_LEN, MAVLINK_MSG_ID_ESEA_SENSE_OUT_CRC);
#else
    mavlink_esea_sense_out_t *packet = (mavlink_esea_sense_out_t *)msgbuf;
    packet->sequence = sequence;
    packet->u_Nm = u_Nm;
    packet->tau_Nm = tau_Nm;
    packet->tau_set_Nm = tau_set_Nm;
    packet->theta_rad = theta_rad;
    packet->theta_motor_rad = theta_motor_rad;
    packet->theta_load_rad = theta_load_rad;
    packet->omega_motor_rad_s = omega_motor_rad_s;
    packet->omega_load_rad_s = omega_load_rad_s;
    packet->delta_set_rad = delta_set_rad;
    packet->tau_h_Nm = tau_h_Nm;
    packet->d4_rad_s2 = d4_rad_s2;
    packet->energy_J = energy_J;
    packet->fault = fault;
    packet->mode_held = mode_held;
    packet->damping_Nms_rad = damping_Nms_rad;
    packet->given_J = given_J;
    packet->held_J = held_J;
    packet->adapted_gain = adapted_gain;
    packet->adapted_loss = adapted_loss;
    packet->adapted_offset_Nm = adapted_offset_Nm;
    packet->encoder_motor_status = encoder_motor_status;
    packet->encoder_load_status = encoder_load_status;
    packet->joint_status = joint_status;
    packet->velocity_status = velocity_status;
    packet->sensor_status = sensor_status;
    packet->motor_rate_status = motor_rate_status;
    packet->load_rate_status = load_rate_status;
    packet->encoder_gear_status = encoder_gear_status;
    packet->adaptation_status = adaptation_status;
    packet->reference_status = reference_status;
    packet->passivity_status = passivity_status;
    packet->lead_status = lead_status;
    packet->inverse_status = inverse_status;
    packet->setpoint_status = setpoint_status;
    packet->smooth_status = smooth_status;
    packet->limits_status = limits_status;
    packet->drive_status = drive_status;
    packet->gear_status = gear_status;
    packet->human_status = human_status;
    packet->set_rate_status = set_rate_status;
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
 * @brief Get field u_Nm from esea_sense_out message
 *
 * @return  motor torque, at the motor shaft; [Nm], range -0.220999986 to 0.220999986
 */
static inline float mavlink_msg_esea_sense_out_get_u_Nm(const mavlink_message_t* msg)
{
    return _MAV_RETURN_float(msg,  4);
}

/**
 * @brief Get field tau_Nm from esea_sense_out message
 *
 * @return  interaction torque on the load; [Nm], range -20 to 20; eq. (3.1)
 */
static inline float mavlink_msg_esea_sense_out_get_tau_Nm(const mavlink_message_t* msg)
{
    return _MAV_RETURN_float(msg,  8);
}

/**
 * @brief Get field tau_set_Nm from esea_sense_out message
 *
 * @return  set torque, for the inverse; [Nm], range -4.46999979 to 4.46999979
 */
static inline float mavlink_msg_esea_sense_out_get_tau_set_Nm(const mavlink_message_t* msg)
{
    return _MAV_RETURN_float(msg,  12);
}

/**
 * @brief Get field theta_rad from esea_sense_out message
 *
 * @return [rad] deflection: motor side minus load side; [rad], range -0.349999994 to 0.349999994
 */
static inline float mavlink_msg_esea_sense_out_get_theta_rad(const mavlink_message_t* msg)
{
    return _MAV_RETURN_float(msg,  16);
}

/**
 * @brief Get field theta_motor_rad from esea_sense_out message
 *
 * @return [rad] joint angle, motor or load side of the coupling; held, at first at count 0, while the encoder is not usable; [rad], range -35 to 35
 */
static inline float mavlink_msg_esea_sense_out_get_theta_motor_rad(const mavlink_message_t* msg)
{
    return _MAV_RETURN_float(msg,  20);
}

/**
 * @brief Get field theta_load_rad from esea_sense_out message
 *
 * @return [rad] joint angle, motor or load side of the coupling; held, at first at count 0, while the encoder is not usable; [rad], range -35 to 35
 */
static inline float mavlink_msg_esea_sense_out_get_theta_load_rad(const mavlink_message_t* msg)
{
    return _MAV_RETURN_float(msg,  24);
}

/**
 * @brief Get field omega_motor_rad_s from esea_sense_out message
 *
 * @return [rad/s] filtered rate of the angle; [rad/s], range -12 to 12
 */
static inline float mavlink_msg_esea_sense_out_get_omega_motor_rad_s(const mavlink_message_t* msg)
{
    return _MAV_RETURN_float(msg,  28);
}

/**
 * @brief Get field omega_load_rad_s from esea_sense_out message
 *
 * @return [rad/s] filtered rate of the angle; [rad/s], range -12 to 12
 */
static inline float mavlink_msg_esea_sense_out_get_omega_load_rad_s(const mavlink_message_t* msg)
{
    return _MAV_RETURN_float(msg,  32);
}

/**
 * @brief Get field delta_set_rad from esea_sense_out message
 *
 * @return [rad] deflection set-point; [rad], range -0.349999994 to 0.349999994
 */
static inline float mavlink_msg_esea_sense_out_get_delta_set_rad(const mavlink_message_t* msg)
{
    return _MAV_RETURN_float(msg,  36);
}

/**
 * @brief Get field tau_h_Nm from esea_sense_out message
 *
 * @return  torque of the person; [Nm], range -20 to 20
 */
static inline float mavlink_msg_esea_sense_out_get_tau_h_Nm(const mavlink_message_t* msg)
{
    return _MAV_RETURN_float(msg,  40);
}

/**
 * @brief Get field d4_rad_s2 from esea_sense_out message
 *
 * @return  disturbance of the drive; [rad/s^2], range -24.666666 to 24.666666; eq. (5.5)
 */
static inline float mavlink_msg_esea_sense_out_get_d4_rad_s2(const mavlink_message_t* msg)
{
    return _MAV_RETURN_float(msg,  44);
}

/**
 * @brief Get field energy_J from esea_sense_out message
 *
 * @return  energy given to the limb within the window; [J], range 0 to 269.306396
 */
static inline float mavlink_msg_esea_sense_out_get_energy_J(const mavlink_message_t* msg)
{
    return _MAV_RETURN_float(msg,  48);
}

/**
 * @brief Get field fault from esea_sense_out message
 *
 * @return  first reason of the latch, one of the FAULT numbers; 0 when released; [dimensionless], range 0 to 15
 */
static inline float mavlink_msg_esea_sense_out_get_fault(const mavlink_message_t* msg)
{
    return _MAV_RETURN_float(msg,  52);
}

/**
 * @brief Get field mode_held from esea_sense_out message
 *
 * @return  mode that holds in this step; [dimensionless], range 0 to 2
 */
static inline float mavlink_msg_esea_sense_out_get_mode_held(const mavlink_message_t* msg)
{
    return _MAV_RETURN_float(msg,  56);
}

/**
 * @brief Get field damping_Nms_rad from esea_sense_out message
 *
 * @return  damping added to what is wanted; [Nm s/rad], range 0 to 0.350349993
 */
static inline float mavlink_msg_esea_sense_out_get_damping_Nms_rad(const mavlink_message_t* msg)
{
    return _MAV_RETURN_float(msg,  60);
}

/**
 * @brief Get field given_J from esea_sense_out message
 *
 * @return  energy given beyond the wanted torque's; [J], range 0 to 120.119995
 */
static inline float mavlink_msg_esea_sense_out_get_given_J(const mavlink_message_t* msg)
{
    return _MAV_RETURN_float(msg,  64);
}

/**
 * @brief Get field held_J from esea_sense_out message
 *
 * @return  that, and what drive and command may still give; [J], range 0 to 173.559555
 */
static inline float mavlink_msg_esea_sense_out_get_held_J(const mavlink_message_t* msg)
{
    return _MAV_RETURN_float(msg,  68);
}

/**
 * @brief Get field adapted_gain from esea_sense_out message
 *
 * @return  model's torque over the true one; [dimensionless], range 0.769230723 to 1.42857134
 */
static inline float mavlink_msg_esea_sense_out_get_adapted_gain(const mavlink_message_t* msg)
{
    return _MAV_RETURN_float(msg,  72);
}

/**
 * @brief Get field adapted_loss from esea_sense_out message
 *
 * @return  stop operator's share in the model's torque; [dimensionless], range -0.399999976 to 0.399999976
 */
static inline float mavlink_msg_esea_sense_out_get_adapted_loss(const mavlink_message_t* msg)
{
    return _MAV_RETURN_float(msg,  76);
}

/**
 * @brief Get field adapted_offset_Nm from esea_sense_out message
 *
 * @return  what the model shows without torque; [Nm], range -0.299999982 to 0.299999982
 */
static inline float mavlink_msg_esea_sense_out_get_adapted_offset_Nm(const mavlink_message_t* msg)
{
    return _MAV_RETURN_float(msg,  80);
}

/**
 * @brief Get field encoder_motor_status from esea_sense_out message
 *
 * @return  what is known of this sample; bits below
 */
static inline uint32_t mavlink_msg_esea_sense_out_get_encoder_motor_status(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint32_t(msg,  84);
}

/**
 * @brief Get field encoder_load_status from esea_sense_out message
 *
 * @return  what is known of this sample; bits below
 */
static inline uint32_t mavlink_msg_esea_sense_out_get_encoder_load_status(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint32_t(msg,  88);
}

/**
 * @brief Get field joint_status from esea_sense_out message
 *
 * @return  what is known of this sample; bits below
 */
static inline uint32_t mavlink_msg_esea_sense_out_get_joint_status(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint32_t(msg,  92);
}

/**
 * @brief Get field velocity_status from esea_sense_out message
 *
 * @return  what is known of this sample; bits below
 */
static inline uint32_t mavlink_msg_esea_sense_out_get_velocity_status(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint32_t(msg,  96);
}

/**
 * @brief Get field sensor_status from esea_sense_out message
 *
 * @return  what is known of this sample; bits below
 */
static inline uint32_t mavlink_msg_esea_sense_out_get_sensor_status(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint32_t(msg,  100);
}

/**
 * @brief Get field motor_rate_status from esea_sense_out message
 *
 * @return  what is known of this sample; bits below
 */
static inline uint32_t mavlink_msg_esea_sense_out_get_motor_rate_status(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint32_t(msg,  104);
}

/**
 * @brief Get field load_rate_status from esea_sense_out message
 *
 * @return  what is known of this sample; bits below
 */
static inline uint32_t mavlink_msg_esea_sense_out_get_load_rate_status(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint32_t(msg,  108);
}

/**
 * @brief Get field encoder_gear_status from esea_sense_out message
 *
 * @return  what is known of this sample; bits below
 */
static inline uint32_t mavlink_msg_esea_sense_out_get_encoder_gear_status(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint32_t(msg,  112);
}

/**
 * @brief Get field adaptation_status from esea_sense_out message
 *
 * @return  what is known of it; bits below
 */
static inline uint32_t mavlink_msg_esea_sense_out_get_adaptation_status(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint32_t(msg,  116);
}

/**
 * @brief Get field reference_status from esea_sense_out message
 *
 * @return  what is known of this set torque; bits below
 */
static inline uint32_t mavlink_msg_esea_sense_out_get_reference_status(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint32_t(msg,  120);
}

/**
 * @brief Get field passivity_status from esea_sense_out message
 *
 * @return  what is known of this step; bits below
 */
static inline uint32_t mavlink_msg_esea_sense_out_get_passivity_status(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint32_t(msg,  124);
}

/**
 * @brief Get field lead_status from esea_sense_out message
 *
 * @return  what is known of it; bits below
 */
static inline uint32_t mavlink_msg_esea_sense_out_get_lead_status(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint32_t(msg,  128);
}

/**
 * @brief Get field inverse_status from esea_sense_out message
 *
 * @return  what is known of this set-point; bits below
 */
static inline uint32_t mavlink_msg_esea_sense_out_get_inverse_status(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint32_t(msg,  132);
}

/**
 * @brief Get field setpoint_status from esea_sense_out message
 *
 * @return  what is known of this set-point; bits below
 */
static inline uint32_t mavlink_msg_esea_sense_out_get_setpoint_status(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint32_t(msg,  136);
}

/**
 * @brief Get field smooth_status from esea_sense_out message
 *
 * @return  what is known of it; bits below
 */
static inline uint32_t mavlink_msg_esea_sense_out_get_smooth_status(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint32_t(msg,  140);
}

/**
 * @brief Get field limits_status from esea_sense_out message
 *
 * @return  which limits act, and what holds the latch; bits below
 */
static inline uint32_t mavlink_msg_esea_sense_out_get_limits_status(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint32_t(msg,  144);
}

/**
 * @brief Get field drive_status from esea_sense_out message
 *
 * @return  what is known of this estimate; bits below
 */
static inline uint32_t mavlink_msg_esea_sense_out_get_drive_status(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint32_t(msg,  148);
}

/**
 * @brief Get field gear_status from esea_sense_out message
 *
 * @return  what is known of this estimate; bits below
 */
static inline uint32_t mavlink_msg_esea_sense_out_get_gear_status(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint32_t(msg,  152);
}

/**
 * @brief Get field human_status from esea_sense_out message
 *
 * @return  what is known of this estimate; bits below
 */
static inline uint32_t mavlink_msg_esea_sense_out_get_human_status(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint32_t(msg,  156);
}

/**
 * @brief Get field set_rate_status from esea_sense_out message
 *
 * @return  what is known of this sample; bits below
 */
static inline uint32_t mavlink_msg_esea_sense_out_get_set_rate_status(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint32_t(msg,  160);
}

/**
 * @brief Get field step_ticks from esea_sense_out message
 *
 * @return  Timer ticks of the step, measuring included (empty_ticks).
 */
static inline uint32_t mavlink_msg_esea_sense_out_get_step_ticks(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint32_t(msg,  164);
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
    esea_sense_out->u_Nm = mavlink_msg_esea_sense_out_get_u_Nm(msg);
    esea_sense_out->tau_Nm = mavlink_msg_esea_sense_out_get_tau_Nm(msg);
    esea_sense_out->tau_set_Nm = mavlink_msg_esea_sense_out_get_tau_set_Nm(msg);
    esea_sense_out->theta_rad = mavlink_msg_esea_sense_out_get_theta_rad(msg);
    esea_sense_out->theta_motor_rad = mavlink_msg_esea_sense_out_get_theta_motor_rad(msg);
    esea_sense_out->theta_load_rad = mavlink_msg_esea_sense_out_get_theta_load_rad(msg);
    esea_sense_out->omega_motor_rad_s = mavlink_msg_esea_sense_out_get_omega_motor_rad_s(msg);
    esea_sense_out->omega_load_rad_s = mavlink_msg_esea_sense_out_get_omega_load_rad_s(msg);
    esea_sense_out->delta_set_rad = mavlink_msg_esea_sense_out_get_delta_set_rad(msg);
    esea_sense_out->tau_h_Nm = mavlink_msg_esea_sense_out_get_tau_h_Nm(msg);
    esea_sense_out->d4_rad_s2 = mavlink_msg_esea_sense_out_get_d4_rad_s2(msg);
    esea_sense_out->energy_J = mavlink_msg_esea_sense_out_get_energy_J(msg);
    esea_sense_out->fault = mavlink_msg_esea_sense_out_get_fault(msg);
    esea_sense_out->mode_held = mavlink_msg_esea_sense_out_get_mode_held(msg);
    esea_sense_out->damping_Nms_rad = mavlink_msg_esea_sense_out_get_damping_Nms_rad(msg);
    esea_sense_out->given_J = mavlink_msg_esea_sense_out_get_given_J(msg);
    esea_sense_out->held_J = mavlink_msg_esea_sense_out_get_held_J(msg);
    esea_sense_out->adapted_gain = mavlink_msg_esea_sense_out_get_adapted_gain(msg);
    esea_sense_out->adapted_loss = mavlink_msg_esea_sense_out_get_adapted_loss(msg);
    esea_sense_out->adapted_offset_Nm = mavlink_msg_esea_sense_out_get_adapted_offset_Nm(msg);
    esea_sense_out->encoder_motor_status = mavlink_msg_esea_sense_out_get_encoder_motor_status(msg);
    esea_sense_out->encoder_load_status = mavlink_msg_esea_sense_out_get_encoder_load_status(msg);
    esea_sense_out->joint_status = mavlink_msg_esea_sense_out_get_joint_status(msg);
    esea_sense_out->velocity_status = mavlink_msg_esea_sense_out_get_velocity_status(msg);
    esea_sense_out->sensor_status = mavlink_msg_esea_sense_out_get_sensor_status(msg);
    esea_sense_out->motor_rate_status = mavlink_msg_esea_sense_out_get_motor_rate_status(msg);
    esea_sense_out->load_rate_status = mavlink_msg_esea_sense_out_get_load_rate_status(msg);
    esea_sense_out->encoder_gear_status = mavlink_msg_esea_sense_out_get_encoder_gear_status(msg);
    esea_sense_out->adaptation_status = mavlink_msg_esea_sense_out_get_adaptation_status(msg);
    esea_sense_out->reference_status = mavlink_msg_esea_sense_out_get_reference_status(msg);
    esea_sense_out->passivity_status = mavlink_msg_esea_sense_out_get_passivity_status(msg);
    esea_sense_out->lead_status = mavlink_msg_esea_sense_out_get_lead_status(msg);
    esea_sense_out->inverse_status = mavlink_msg_esea_sense_out_get_inverse_status(msg);
    esea_sense_out->setpoint_status = mavlink_msg_esea_sense_out_get_setpoint_status(msg);
    esea_sense_out->smooth_status = mavlink_msg_esea_sense_out_get_smooth_status(msg);
    esea_sense_out->limits_status = mavlink_msg_esea_sense_out_get_limits_status(msg);
    esea_sense_out->drive_status = mavlink_msg_esea_sense_out_get_drive_status(msg);
    esea_sense_out->gear_status = mavlink_msg_esea_sense_out_get_gear_status(msg);
    esea_sense_out->human_status = mavlink_msg_esea_sense_out_get_human_status(msg);
    esea_sense_out->set_rate_status = mavlink_msg_esea_sense_out_get_set_rate_status(msg);
    esea_sense_out->step_ticks = mavlink_msg_esea_sense_out_get_step_ticks(msg);
#else
        uint8_t len = msg->len < MAVLINK_MSG_ID_ESEA_SENSE_OUT_LEN? msg->len : MAVLINK_MSG_ID_ESEA_SENSE_OUT_LEN;
        memset(esea_sense_out, 0, MAVLINK_MSG_ID_ESEA_SENSE_OUT_LEN);
    memcpy(esea_sense_out, _MAV_PAYLOAD(msg), len);
#endif
}
