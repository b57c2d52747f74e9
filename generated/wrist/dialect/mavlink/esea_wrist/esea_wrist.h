/** @file
 *  @brief MAVLink comm protocol generated from esea_wrist.xml
 *  @see http://mavlink.org
 */
#pragma once
#ifndef MAVLINK_ESEA_WRIST_H
#define MAVLINK_ESEA_WRIST_H

#ifndef MAVLINK_H
    #error Wrong include order: MAVLINK_ESEA_WRIST.H MUST NOT BE DIRECTLY USED. Include mavlink.h from the same directory instead or set ALL AND EVERY defines from MAVLINK.H manually accordingly, including the #define MAVLINK_H call.
#endif

#define MAVLINK_ESEA_WRIST_XML_HASH 8661348050055080438

#ifdef __cplusplus
extern "C" {
#endif

// MESSAGE LENGTHS AND CRCS

#ifndef MAVLINK_MESSAGE_LENGTHS
#define MAVLINK_MESSAGE_LENGTHS {}
#endif

#ifndef MAVLINK_MESSAGE_CRCS
#define MAVLINK_MESSAGE_CRCS {{0, 50, 9, 9, 0, 0, 0}, {20, 214, 20, 20, 3, 2, 3}, {21, 159, 2, 2, 3, 0, 1}, {22, 220, 25, 25, 0, 0, 0}, {23, 168, 23, 23, 3, 4, 5}, {76, 152, 33, 33, 3, 30, 31}, {77, 143, 3, 10, 3, 8, 9}, {111, 34, 16, 16, 0, 0, 0}, {253, 83, 51, 54, 0, 0, 0}, {256, 71, 42, 42, 3, 8, 9}, {345, 209, 21, 21, 3, 2, 3}, {42600, 248, 92, 92, 0, 0, 0}, {42601, 121, 12, 12, 0, 0, 0}, {42602, 198, 72, 72, 0, 0, 0}, {42661, 167, 32, 32, 0, 0, 0}, {42662, 182, 67, 67, 0, 0, 0}, {42663, 36, 253, 253, 0, 0, 0}, {42664, 102, 32, 32, 0, 0, 0}, {42665, 247, 244, 244, 0, 0, 0}, {42666, 84, 59, 59, 0, 0, 0}, {42667, 80, 243, 243, 0, 0, 0}, {42668, 239, 216, 216, 0, 0, 0}, {42669, 226, 16, 16, 0, 0, 0}}
#endif

#include "../protocol.h"

#define MAVLINK_ENABLED_ESEA_WRIST

// ENUM DEFINITIONS


/** @brief Component type; the entries in use. */
#ifndef HAVE_ENUM_MAV_TYPE
#define HAVE_ENUM_MAV_TYPE
typedef enum MAV_TYPE
{
   MAV_TYPE_GENERIC=0, /* The controller board. | */
   MAV_TYPE_FIXED_WING=1, /* Not in use; pymavlink's client asks for it. | */
   MAV_TYPE_GCS=6, /* The host. | */
   MAV_TYPE_ONBOARD_CONTROLLER=18, /* Not in use; pymavlink's client asks for it. | */
   MAV_TYPE_GIMBAL=26, /* Not in use; pymavlink's client asks for it. | */
   MAV_TYPE_ADSB=27, /* Not in use; pymavlink's client asks for it. | */
   MAV_TYPE_ENUM_END=28, /*  | */
} MAV_TYPE;
#endif

/** @brief Autopilot class; the entries in use. */
#ifndef HAVE_ENUM_MAV_AUTOPILOT
#define HAVE_ENUM_MAV_AUTOPILOT
typedef enum MAV_AUTOPILOT
{
   MAV_AUTOPILOT_GENERIC=0, /* Not in use; pymavlink's client asks for it. | */
   MAV_AUTOPILOT_ARDUPILOTMEGA=3, /* Not in use; pymavlink's client asks for it. | */
   MAV_AUTOPILOT_INVALID=8, /* No autopilot. | */
   MAV_AUTOPILOT_ENUM_END=9, /*  | */
} MAV_AUTOPILOT;
#endif

/** @brief Mode bits; those in use. */
#ifndef HAVE_ENUM_MAV_MODE_FLAG
#define HAVE_ENUM_MAV_MODE_FLAG
typedef enum MAV_MODE_FLAG
{
   MAV_MODE_FLAG_CUSTOM_MODE_ENABLED=1, /* custom_mode holds an ESEA_STATE. | */
   MAV_MODE_FLAG_SAFETY_ARMED=128, /* The motor may be on. | */
   MAV_MODE_FLAG_ENUM_END=129, /*  | */
} MAV_MODE_FLAG;
#endif

/** @brief Components; the entry that is asked for. */
#ifndef HAVE_ENUM_MAV_COMPONENT
#define HAVE_ENUM_MAV_COMPONENT
typedef enum MAV_COMPONENT
{
   MAV_COMP_ID_GIMBAL=154, /* Not in use; pymavlink's client asks for it. | */
   MAV_COMPONENT_ENUM_END=155, /*  | */
} MAV_COMPONENT;
#endif

/** @brief Component state; the entries in use. */
#ifndef HAVE_ENUM_MAV_STATE
#define HAVE_ENUM_MAV_STATE
typedef enum MAV_STATE
{
   MAV_STATE_BOOT=1, /* Starting. | */
   MAV_STATE_CALIBRATING=2, /* Taking the encoders' zeros. | */
   MAV_STATE_STANDBY=3, /* At rest, motor off. | */
   MAV_STATE_ACTIVE=4, /* Motor on, or stepping on the host's inputs. | */
   MAV_STATE_CRITICAL=5, /* A fault is latched, motor off. | */
   MAV_STATE_EMERGENCY=6, /* The processor has stopped after a hardware fault. | */
   MAV_STATE_ENUM_END=7, /*  | */
} MAV_STATE;
#endif

/** @brief Result of a command; the entries in use. */
#ifndef HAVE_ENUM_MAV_RESULT
#define HAVE_ENUM_MAV_RESULT
typedef enum MAV_RESULT
{
   MAV_RESULT_ACCEPTED=0, /* Done. | */
   MAV_RESULT_TEMPORARILY_REJECTED=1, /* Not in this state; the table of states says in which. | */
   MAV_RESULT_DENIED=2, /* A parameter is invalid, it is not signed, or it came too late. | */
   MAV_RESULT_UNSUPPORTED=3, /* Unknown command. | */
   MAV_RESULT_FAILED=4, /* Not done; the HEARTBEAT and ESEA_INFO tell why. | */
   MAV_RESULT_ENUM_END=5, /*  | */
} MAV_RESULT;
#endif

/** @brief Commands; the entries in use. */
#ifndef HAVE_ENUM_MAV_CMD
#define HAVE_ENUM_MAV_CMD
typedef enum MAV_CMD
{
   MAV_CMD_PREFLIGHT_STORAGE=245, /* Parameters to or from storage, with the motor off. |0: those that were saved; 1: save what stands; 2: defaults.| Reserved (default:0)| Reserved (default:0)| Reserved (default:0)| Reserved (default:0)| Reserved (default:0)| Reserved (default:0)|  */
   MAV_CMD_COMPONENT_ARM_DISARM=400, /* Switch the motor on or off. |1 on; anything else off.| Reserved (default:0)| Reserved (default:0)| Reserved (default:0)| Reserved (default:0)| Reserved (default:0)| Reserved (default:0)|  */
   MAV_CMD_SET_MESSAGE_INTERVAL=511, /* Tell the inputs or outputs of a task's runs on the board's own clock. |Id of the task's message.| Time between two, rounded up to runs of the task; 0 and less: none.| Reserved (default:0)| Reserved (default:0)| Reserved (default:0)| Reserved (default:0)| Reserved (default:0)|  */
   MAV_CMD_REQUEST_MESSAGE=512, /* Send one HEARTBEAT, ESEA_INFO, ESEA_CLOCK, ESEA_TRAFFIC, ESEA_KEPT or ESEA_LIFE. |Id of the message.| Reserved (default:0)| Reserved (default:0)| Reserved (default:0)| Reserved (default:0)| Reserved (default:0)| Reserved (default:0)|  */
   MAV_CMD_USER_1=31010, /* Reset: self-test, initial state of every Block, counters to 0. A stop that is held stays. |Reserved (default:0)| Reserved (default:0)| Reserved (default:0)| Reserved (default:0)| Reserved (default:0)| Reserved (default:0)| Reserved (default:0)|  */
   MAV_CMD_USER_2=31011, /* Zero: the joint is at its zero and unloaded; take the encoders' angles. |Reserved (default:0)| Reserved (default:0)| Reserved (default:0)| Reserved (default:0)| Reserved (default:0)| Reserved (default:0)| Reserved (default:0)|  */
   MAV_CMD_USER_3=31012, /* Clear: the fault has been seen to. |Reserved (default:0)| Reserved (default:0)| Reserved (default:0)| Reserved (default:0)| Reserved (default:0)| Reserved (default:0)| Reserved (default:0)|  */
   MAV_CMD_USER_4=31013, /* Stop. Taken always, from anybody, whoever it is for. |Reserved (default:0)| Reserved (default:0)| Reserved (default:0)| Reserved (default:0)| Reserved (default:0)| Reserved (default:0)| Reserved (default:0)|  */
   MAV_CMD_USER_5=31014, /* Release: take the stop back. |Reserved (default:0)| Reserved (default:0)| Reserved (default:0)| Reserved (default:0)| Reserved (default:0)| Reserved (default:0)| Reserved (default:0)|  */
   MAV_CMD_ENUM_END=31015, /*  | */
} MAV_CMD;
#endif

/** @brief State of the board, in HEARTBEAT.custom_mode. */
#ifndef HAVE_ENUM_ESEA_STATE
#define HAVE_ENUM_ESEA_STATE
typedef enum ESEA_STATE
{
   ESEA_STATE_BOOT=0, /* Starting. | */
   ESEA_STATE_READY=1, /* All is known; waits to be armed. | */
   ESEA_STATE_REPLAY=2, /* The host's inputs clock the tasks, one run each; drivers and own clock rest. | */
   ESEA_STATE_FAULT=3, /* A fault is latched; its number tells which. | */
   ESEA_STATE_SELF_TEST=4, /* Checks itself. | */
   ESEA_STATE_UNREFERENCED=5, /* Encoders have no zero; waits to be zeroed. | */
   ESEA_STATE_ZEROING=6, /* Takes the present angles, which must stand still, as zero. | */
   ESEA_STATE_ARMED=7, /* The motor is on, without torque; waits for a command. | */
   ESEA_STATE_ACTIVE=8, /* Follows the host's commands. | */
   ESEA_STATE_LETTING_GO=9, /* No command came in time, or disarmed while active: the torque fades to none. | */
   ESEA_STATE_STOPPED=10, /* Stopped by somebody; waits to be released. | */
   ESEA_STATE_ENUM_END=11, /*  | */
} ESEA_STATE;
#endif

/** @brief Faults: the board's in ESEA_INFO.fault (101 and more), reasons of the limits in the outputs called fault. */
#ifndef HAVE_ENUM_ESEA_FAULT
#define HAVE_ENUM_ESEA_FAULT
typedef enum ESEA_FAULT
{
   ESEA_FAULT_NONE=0, /* No fault. Cure: nothing to do. | */
   ESEA_FAULT_PREPARE_REFUSED=101, /* A tunable's default is outside its range. Cure: build the firmware from a device file that esea-gen accepts. Found: at start, before anything is computed. | */
   ESEA_FAULT_STACK_EXHAUSTED=102, /* The stack has been used to its last word. Cure: reset; give the stack more memory in the linker script. Found: 1000 ticks; beyond the last word at once, as PROCESSOR. | */
   ESEA_FAULT_PROCESSOR=103, /* The processor took a fault exception. Cure: reset; if it comes again, service. Found: at once. | */
   ESEA_FAULT_SELF_TEST=104, /* Freshly started limits did not hold the motor at zero. Cure: service: program memory is not what was built. Found: at start, before the motor can be on. | */
   ESEA_FAULT_STATE_UNKNOWN=105, /* The board's state was none of its list: memory was overwritten. Cure: reset; if it comes again, service. Found: 1 tick. | */
   ESEA_FAULT_MOTOR_CURRENT=106, /* The motor's current was not what was set. Cure: reset; look at the amplifier, its supply, the wires of motor and current. Found: 20 ticks beyond the bound, while the motor is on. | */
   ESEA_FAULT_WATCHDOG=107, /* The watchdog reset the board: no control cycle had ended in time. Cure: read the black box, reset; if it comes again, service. Found: 68 to 188 ms after the last cycle, told after the start. | */
   ESEA_FAULT_BROWN_OUT=108, /* The board's supply is too low. Cure: look at the supply, then reset. Found: 1 tick. | */
   ESEA_FAULT_ENUM_END=109, /*  | */
} ESEA_FAULT;
#endif

/** @brief Where the zero of the encoders comes from. */
#ifndef HAVE_ENUM_ESEA_ZERO
#define HAVE_ENUM_ESEA_ZERO
typedef enum ESEA_ZERO
{
   ESEA_ZERO_NONE=0, /* There is none: zero the joint. | */
   ESEA_ZERO_TAKEN=1, /* Taken since power-on. | */
   ESEA_ZERO_PUT_BACK=2, /* Put back at the start, as it was kept for these serial numbers. | */
   ESEA_ZERO_ENUM_END=3, /*  | */
} ESEA_ZERO;
#endif

/** @brief Type of a parameter; the entry in use. */
#ifndef HAVE_ENUM_MAV_PARAM_TYPE
#define HAVE_ENUM_MAV_PARAM_TYPE
typedef enum MAV_PARAM_TYPE
{
   MAV_PARAM_TYPE_REAL32=9, /* Single precision. | */
   MAV_PARAM_TYPE_ENUM_END=10, /*  | */
} MAV_PARAM_TYPE;
#endif

/** @brief Why a parameter was not read or set; the entries in use. */
#ifndef HAVE_ENUM_MAV_PARAM_ERROR
#define HAVE_ENUM_MAV_PARAM_ERROR
typedef enum MAV_PARAM_ERROR
{
   MAV_PARAM_ERROR_NO_ERROR=0, /* It was. | */
   MAV_PARAM_ERROR_DOES_NOT_EXIST=1, /* There is none of this id or index. | */
   MAV_PARAM_ERROR_VALUE_OUT_OF_RANGE=2, /* Outside its bounds, not a number, or not of type REAL32. | */
   MAV_PARAM_ERROR_PERMISSION_DENIED=3, /* Not in this state, not signed, or too late. | */
   MAV_PARAM_ERROR_READ_ONLY=5, /* A calibration sets it. | */
   MAV_PARAM_ERROR_ENUM_END=6, /*  | */
} MAV_PARAM_ERROR;
#endif

/** @brief Severity of a text; the entries in use. */
#ifndef HAVE_ENUM_MAV_SEVERITY
#define HAVE_ENUM_MAV_SEVERITY
typedef enum MAV_SEVERITY
{
   MAV_SEVERITY_CRITICAL=2, /* A fault is latched. | */
   MAV_SEVERITY_WARNING=4, /* Something was refused. | */
   MAV_SEVERITY_INFO=6, /* For information. | */
   MAV_SEVERITY_ENUM_END=7, /*  | */
} MAV_SEVERITY;
#endif

/** @brief Parameters by index: what each means, then full name, id, unit, least, most, default, and whether only a calibration sets it. */
#ifndef HAVE_ENUM_ESEA_PARAM
#define HAVE_ENUM_ESEA_PARAM
typedef enum ESEA_PARAM
{
   ESEA_PARAM_VELOCITY_FLEXION_BANDWIDTH_HZ=0, /* bandwidth of the triple pole: higher follows faster and passes more noise |velocity_flexion.bandwidth_Hz| vlcty_f.bndwdth| Hz| 2| 100| 15| free|  */
   ESEA_PARAM_VELOCITY_DEVIATION_BANDWIDTH_HZ=1, /* bandwidth of the triple pole: higher follows faster and passes more noise |velocity_deviation.bandwidth_Hz| vlcty_d.bndwdth| Hz| 2| 100| 15| free|  */
   ESEA_PARAM_ENUM_END=2, /*  | */
} ESEA_PARAM;
#endif

/** @brief what is known of this sample */
#ifndef HAVE_ENUM_ESEA_WRIST_SENSOR_FLEXION_STATUS
#define HAVE_ENUM_ESEA_WRIST_SENSOR_FLEXION_STATUS
typedef enum ESEA_WRIST_SENSOR_FLEXION_STATUS
{
   ESEA_WRIST_SENSOR_FLEXION_STATUS_INPUT_INVALID=1, /* an input was NaN or outside its physical range; the last deflection is held | */
   ESEA_WRIST_SENSOR_FLEXION_STATUS_STATE_REPAIRED=2, /* the state was corrupt; the model was started afresh | */
   ESEA_WRIST_SENSOR_FLEXION_STATUS_THETA_OUTSIDE=4, /* |deflection| is outside the identified domain | */
   ESEA_WRIST_SENSOR_FLEXION_STATUS_RATE_OUTSIDE=8, /* |deflection rate| is outside the identified domain | */
   ESEA_WRIST_SENSOR_FLEXION_STATUS_TORQUE_OUTSIDE=16, /* |torque| is above full scale | */
   ESEA_WRIST_SENSOR_FLEXION_STATUS_STEP_CLIPPED=32, /* deflection jumped by more than its rate allows; clipped | */
   ESEA_WRIST_SENSOR_FLEXION_STATUS_RATE_TORQUE_CLIPPED=64, /* the Maxwell element's torque was clipped at its limit | */
   ESEA_WRIST_SENSOR_FLEXION_STATUS_ENUM_END=65, /*  | */
} ESEA_WRIST_SENSOR_FLEXION_STATUS;
#endif

/** @brief what is known of this sample */
#ifndef HAVE_ENUM_ESEA_WRIST_VELOCITY_FLEXION_STATUS
#define HAVE_ENUM_ESEA_WRIST_VELOCITY_FLEXION_STATUS
typedef enum ESEA_WRIST_VELOCITY_FLEXION_STATUS
{
   ESEA_WRIST_VELOCITY_FLEXION_STATUS_INPUT_INVALID=1, /* the deflection was NaN or outside its range; the last estimate is held | */
   ESEA_WRIST_VELOCITY_FLEXION_STATUS_STATE_REPAIRED=2, /* the state was corrupt; the observer was started afresh | */
   ESEA_WRIST_VELOCITY_FLEXION_STATUS_RATE_CLIPPED=4, /* the estimate was clipped at the rate's physical range | */
   ESEA_WRIST_VELOCITY_FLEXION_STATUS_ENUM_END=5, /*  | */
} ESEA_WRIST_VELOCITY_FLEXION_STATUS;
#endif

/** @brief what is known of this sample */
#ifndef HAVE_ENUM_ESEA_WRIST_SENSOR_DEVIATION_STATUS
#define HAVE_ENUM_ESEA_WRIST_SENSOR_DEVIATION_STATUS
typedef enum ESEA_WRIST_SENSOR_DEVIATION_STATUS
{
   ESEA_WRIST_SENSOR_DEVIATION_STATUS_INPUT_INVALID=1, /* an input was NaN or outside its physical range; the last deflection is held | */
   ESEA_WRIST_SENSOR_DEVIATION_STATUS_STATE_REPAIRED=2, /* the state was corrupt; the model was started afresh | */
   ESEA_WRIST_SENSOR_DEVIATION_STATUS_THETA_OUTSIDE=4, /* |deflection| is outside the identified domain | */
   ESEA_WRIST_SENSOR_DEVIATION_STATUS_RATE_OUTSIDE=8, /* |deflection rate| is outside the identified domain | */
   ESEA_WRIST_SENSOR_DEVIATION_STATUS_TORQUE_OUTSIDE=16, /* |torque| is above full scale | */
   ESEA_WRIST_SENSOR_DEVIATION_STATUS_STEP_CLIPPED=32, /* deflection jumped by more than its rate allows; clipped | */
   ESEA_WRIST_SENSOR_DEVIATION_STATUS_RATE_TORQUE_CLIPPED=64, /* the Maxwell element's torque was clipped at its limit | */
   ESEA_WRIST_SENSOR_DEVIATION_STATUS_ENUM_END=65, /*  | */
} ESEA_WRIST_SENSOR_DEVIATION_STATUS;
#endif

/** @brief what is known of this sample */
#ifndef HAVE_ENUM_ESEA_WRIST_VELOCITY_DEVIATION_STATUS
#define HAVE_ENUM_ESEA_WRIST_VELOCITY_DEVIATION_STATUS
typedef enum ESEA_WRIST_VELOCITY_DEVIATION_STATUS
{
   ESEA_WRIST_VELOCITY_DEVIATION_STATUS_INPUT_INVALID=1, /* the deflection was NaN or outside its range; the last estimate is held | */
   ESEA_WRIST_VELOCITY_DEVIATION_STATUS_STATE_REPAIRED=2, /* the state was corrupt; the observer was started afresh | */
   ESEA_WRIST_VELOCITY_DEVIATION_STATUS_RATE_CLIPPED=4, /* the estimate was clipped at the rate's physical range | */
   ESEA_WRIST_VELOCITY_DEVIATION_STATUS_ENUM_END=5, /*  | */
} ESEA_WRIST_VELOCITY_DEVIATION_STATUS;
#endif

/** @brief what is known of this sample */
#ifndef HAVE_ENUM_ESEA_WRIST_SMOOTHING_FLEXION_STATUS
#define HAVE_ENUM_ESEA_WRIST_SMOOTHING_FLEXION_STATUS
typedef enum ESEA_WRIST_SMOOTHING_FLEXION_STATUS
{
   ESEA_WRIST_SMOOTHING_FLEXION_STATUS_INPUT_INVALID=1, /* deflection or rate was NaN or outside its range; the last one is held | */
   ESEA_WRIST_SMOOTHING_FLEXION_STATUS_STATE_REPAIRED=2, /* the state was corrupt; it was started afresh | */
   ESEA_WRIST_SMOOTHING_FLEXION_STATUS_ENUM_END=3, /*  | */
} ESEA_WRIST_SMOOTHING_FLEXION_STATUS;
#endif

/** @brief what is known of this sample */
#ifndef HAVE_ENUM_ESEA_WRIST_SMOOTHING_DEVIATION_STATUS
#define HAVE_ENUM_ESEA_WRIST_SMOOTHING_DEVIATION_STATUS
typedef enum ESEA_WRIST_SMOOTHING_DEVIATION_STATUS
{
   ESEA_WRIST_SMOOTHING_DEVIATION_STATUS_INPUT_INVALID=1, /* deflection or rate was NaN or outside its range; the last one is held | */
   ESEA_WRIST_SMOOTHING_DEVIATION_STATUS_STATE_REPAIRED=2, /* the state was corrupt; it was started afresh | */
   ESEA_WRIST_SMOOTHING_DEVIATION_STATUS_ENUM_END=3, /*  | */
} ESEA_WRIST_SMOOTHING_DEVIATION_STATUS;
#endif

// MAVLINK VERSION

#ifndef MAVLINK_VERSION
#define MAVLINK_VERSION 3
#endif

#if (MAVLINK_VERSION == 0)
#undef MAVLINK_VERSION
#define MAVLINK_VERSION 3
#endif

// MESSAGE DEFINITIONS
#include "./mavlink_msg_heartbeat.h"
#include "./mavlink_msg_param_request_read.h"
#include "./mavlink_msg_param_request_list.h"
#include "./mavlink_msg_param_value.h"
#include "./mavlink_msg_param_set.h"
#include "./mavlink_msg_command_long.h"
#include "./mavlink_msg_command_ack.h"
#include "./mavlink_msg_timesync.h"
#include "./mavlink_msg_statustext.h"
#include "./mavlink_msg_setup_signing.h"
#include "./mavlink_msg_param_error.h"
#include "./mavlink_msg_esea_info.h"
#include "./mavlink_msg_esea_sense_in.h"
#include "./mavlink_msg_esea_sense_out.h"
#include "./mavlink_msg_esea_clock.h"
#include "./mavlink_msg_esea_stream.h"
#include "./mavlink_msg_esea_data.h"
#include "./mavlink_msg_esea_traffic.h"
#include "./mavlink_msg_esea_key.h"
#include "./mavlink_msg_esea_kept.h"
#include "./mavlink_msg_esea_blackbox.h"
#include "./mavlink_msg_esea_life.h"
#include "./mavlink_msg_esea_stamp.h"

// base include



#if MAVLINK_ESEA_WRIST_XML_HASH == MAVLINK_PRIMARY_XML_HASH
# define MAVLINK_MESSAGE_INFO {MAVLINK_MESSAGE_INFO_HEARTBEAT, MAVLINK_MESSAGE_INFO_PARAM_REQUEST_READ, MAVLINK_MESSAGE_INFO_PARAM_REQUEST_LIST, MAVLINK_MESSAGE_INFO_PARAM_VALUE, MAVLINK_MESSAGE_INFO_PARAM_SET, MAVLINK_MESSAGE_INFO_COMMAND_LONG, MAVLINK_MESSAGE_INFO_COMMAND_ACK, MAVLINK_MESSAGE_INFO_TIMESYNC, MAVLINK_MESSAGE_INFO_STATUSTEXT, MAVLINK_MESSAGE_INFO_SETUP_SIGNING, MAVLINK_MESSAGE_INFO_PARAM_ERROR, MAVLINK_MESSAGE_INFO_ESEA_INFO, MAVLINK_MESSAGE_INFO_ESEA_SENSE_IN, MAVLINK_MESSAGE_INFO_ESEA_SENSE_OUT, MAVLINK_MESSAGE_INFO_ESEA_CLOCK, MAVLINK_MESSAGE_INFO_ESEA_STREAM, MAVLINK_MESSAGE_INFO_ESEA_DATA, MAVLINK_MESSAGE_INFO_ESEA_TRAFFIC, MAVLINK_MESSAGE_INFO_ESEA_KEY, MAVLINK_MESSAGE_INFO_ESEA_KEPT, MAVLINK_MESSAGE_INFO_ESEA_BLACKBOX, MAVLINK_MESSAGE_INFO_ESEA_LIFE, MAVLINK_MESSAGE_INFO_ESEA_STAMP}
# define MAVLINK_MESSAGE_NAMES {{ "COMMAND_ACK", 77 }, { "COMMAND_LONG", 76 }, { "ESEA_BLACKBOX", 42667 }, { "ESEA_CLOCK", 42661 }, { "ESEA_DATA", 42663 }, { "ESEA_INFO", 42600 }, { "ESEA_KEPT", 42666 }, { "ESEA_KEY", 42665 }, { "ESEA_LIFE", 42668 }, { "ESEA_SENSE_IN", 42601 }, { "ESEA_SENSE_OUT", 42602 }, { "ESEA_STAMP", 42669 }, { "ESEA_STREAM", 42662 }, { "ESEA_TRAFFIC", 42664 }, { "HEARTBEAT", 0 }, { "PARAM_ERROR", 345 }, { "PARAM_REQUEST_LIST", 21 }, { "PARAM_REQUEST_READ", 20 }, { "PARAM_SET", 23 }, { "PARAM_VALUE", 22 }, { "SETUP_SIGNING", 256 }, { "STATUSTEXT", 253 }, { "TIMESYNC", 111 }}
# if MAVLINK_COMMAND_24BIT
#  include "../mavlink_get_info.h"
# endif
#endif

#ifdef __cplusplus
}
#endif // __cplusplus
#endif // MAVLINK_ESEA_WRIST_H
