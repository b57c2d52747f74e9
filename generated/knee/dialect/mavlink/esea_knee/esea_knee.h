/** @file
 *  @brief MAVLink comm protocol generated from esea_knee.xml
 *  @see http://mavlink.org
 */
#pragma once
#ifndef MAVLINK_ESEA_KNEE_H
#define MAVLINK_ESEA_KNEE_H

#ifndef MAVLINK_H
    #error Wrong include order: MAVLINK_ESEA_KNEE.H MUST NOT BE DIRECTLY USED. Include mavlink.h from the same directory instead or set ALL AND EVERY defines from MAVLINK.H manually accordingly, including the #define MAVLINK_H call.
#endif

#define MAVLINK_ESEA_KNEE_XML_HASH -5725898442328360519

#ifdef __cplusplus
extern "C" {
#endif

// MESSAGE LENGTHS AND CRCS

#ifndef MAVLINK_MESSAGE_LENGTHS
#define MAVLINK_MESSAGE_LENGTHS {}
#endif

#ifndef MAVLINK_MESSAGE_CRCS
#define MAVLINK_MESSAGE_CRCS {{0, 50, 9, 9, 0, 0, 0}, {76, 152, 33, 33, 3, 30, 31}, {77, 143, 3, 10, 3, 8, 9}, {42600, 248, 92, 92, 0, 0, 0}, {42601, 118, 8, 8, 0, 0, 0}, {42602, 240, 36, 36, 0, 0, 0}}
#endif

#include "../protocol.h"

#define MAVLINK_ENABLED_ESEA_KNEE

// ENUM DEFINITIONS


/** @brief Component type; the entries in use. */
#ifndef HAVE_ENUM_MAV_TYPE
#define HAVE_ENUM_MAV_TYPE
typedef enum MAV_TYPE
{
   MAV_TYPE_GENERIC=0, /* The controller board. | */
   MAV_TYPE_GCS=6, /* The host. | */
   MAV_TYPE_ENUM_END=7, /*  | */
} MAV_TYPE;
#endif

/** @brief Autopilot class; the entry in use. */
#ifndef HAVE_ENUM_MAV_AUTOPILOT
#define HAVE_ENUM_MAV_AUTOPILOT
typedef enum MAV_AUTOPILOT
{
   MAV_AUTOPILOT_INVALID=8, /* No autopilot. | */
   MAV_AUTOPILOT_ENUM_END=9, /*  | */
} MAV_AUTOPILOT;
#endif

/** @brief Mode bits; the one in use. */
#ifndef HAVE_ENUM_MAV_MODE_FLAG
#define HAVE_ENUM_MAV_MODE_FLAG
typedef enum MAV_MODE_FLAG
{
   MAV_MODE_FLAG_CUSTOM_MODE_ENABLED=1, /* custom_mode holds an ESEA_MODE. | */
   MAV_MODE_FLAG_ENUM_END=2, /*  | */
} MAV_MODE_FLAG;
#endif

/** @brief Component state; the entries in use. */
#ifndef HAVE_ENUM_MAV_STATE
#define HAVE_ENUM_MAV_STATE
typedef enum MAV_STATE
{
   MAV_STATE_BOOT=1, /* Starting. | */
   MAV_STATE_STANDBY=3, /* Ready for the first input. | */
   MAV_STATE_ACTIVE=4, /* Stepping. | */
   MAV_STATE_CRITICAL=5, /* A fault is latched; no step is taken until a reset. | */
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
   MAV_RESULT_DENIED=2, /* A parameter is invalid. | */
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
   MAV_CMD_REQUEST_MESSAGE=512, /* Send one HEARTBEAT or ESEA_INFO. |Id of the message.| Reserved (default:0)| Reserved (default:0)| Reserved (default:0)| Reserved (default:0)| Reserved (default:0)| Reserved (default:0)|  */
   MAV_CMD_USER_1=31010, /* Reset: initial state of every Block, counters to 0, latched fault released. |Reserved (default:0)| Reserved (default:0)| Reserved (default:0)| Reserved (default:0)| Reserved (default:0)| Reserved (default:0)| Reserved (default:0)|  */
   MAV_CMD_ENUM_END=31011, /*  | */
} MAV_CMD;
#endif

/** @brief State of the firmware, in HEARTBEAT.custom_mode. */
#ifndef HAVE_ENUM_ESEA_MODE
#define HAVE_ENUM_ESEA_MODE
typedef enum ESEA_MODE
{
   ESEA_MODE_BOOT=0, /* Starting; no input is taken. | */
   ESEA_MODE_READY=1, /* Initial state; waits for the first input. | */
   ESEA_MODE_RUNNING=2, /* Takes one step per input. | */
   ESEA_MODE_FAULT=3, /* A fault is latched; inputs are answered by a HEARTBEAT until a reset. | */
   ESEA_MODE_ENUM_END=4, /*  | */
} ESEA_MODE;
#endif

/** @brief Faults: the board's in ESEA_INFO.fault (101 and more), reasons of the limits in the outputs called fault. */
#ifndef HAVE_ENUM_ESEA_FAULT
#define HAVE_ENUM_ESEA_FAULT
typedef enum ESEA_FAULT
{
   ESEA_FAULT_NONE=0, /* No fault. Cure: nothing to do. | */
   ESEA_FAULT_PREPARE_REFUSED=101, /* A tunable's default is outside its range. Cure: build the firmware from a device file that esea-gen accepts. | */
   ESEA_FAULT_STACK_EXHAUSTED=102, /* The stack has been used to its last word. Cure: reset; give the stack more memory in the linker script. | */
   ESEA_FAULT_PROCESSOR=103, /* The processor took a fault exception. Cure: reset; if it comes again, service. | */
   ESEA_FAULT_ENUM_END=104, /*  | */
} ESEA_FAULT;
#endif

/** @brief what is known of this sample */
#ifndef HAVE_ENUM_ESEA_KNEE_SENSOR_STATUS
#define HAVE_ENUM_ESEA_KNEE_SENSOR_STATUS
typedef enum ESEA_KNEE_SENSOR_STATUS
{
   ESEA_KNEE_SENSOR_STATUS_INPUT_INVALID=1, /* an input was NaN or outside its physical range; the last deflection is held | */
   ESEA_KNEE_SENSOR_STATUS_STATE_REPAIRED=2, /* the state was corrupt; the model was started afresh | */
   ESEA_KNEE_SENSOR_STATUS_THETA_OUTSIDE=4, /* |deflection| is outside the identified domain | */
   ESEA_KNEE_SENSOR_STATUS_RATE_OUTSIDE=8, /* |deflection rate| is outside the identified domain | */
   ESEA_KNEE_SENSOR_STATUS_TORQUE_OUTSIDE=16, /* |torque| is above full scale | */
   ESEA_KNEE_SENSOR_STATUS_STEP_CLIPPED=32, /* deflection jumped by more than its rate allows; clipped | */
   ESEA_KNEE_SENSOR_STATUS_RATE_TORQUE_CLIPPED=64, /* the Maxwell element's torque was clipped at its limit | */
   ESEA_KNEE_SENSOR_STATUS_ENUM_END=65, /*  | */
} ESEA_KNEE_SENSOR_STATUS;
#endif

/** @brief what is known of this sample */
#ifndef HAVE_ENUM_ESEA_KNEE_VELOCITY_STATUS
#define HAVE_ENUM_ESEA_KNEE_VELOCITY_STATUS
typedef enum ESEA_KNEE_VELOCITY_STATUS
{
   ESEA_KNEE_VELOCITY_STATUS_INPUT_INVALID=1, /* the deflection was NaN or outside its range; the last estimate is held | */
   ESEA_KNEE_VELOCITY_STATUS_STATE_REPAIRED=2, /* the state was corrupt; the observer was started afresh | */
   ESEA_KNEE_VELOCITY_STATUS_RATE_CLIPPED=4, /* the estimate was clipped at the rate's physical range | */
   ESEA_KNEE_VELOCITY_STATUS_ENUM_END=5, /*  | */
} ESEA_KNEE_VELOCITY_STATUS;
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
#include "./mavlink_msg_command_long.h"
#include "./mavlink_msg_command_ack.h"
#include "./mavlink_msg_esea_info.h"
#include "./mavlink_msg_esea_sense_in.h"
#include "./mavlink_msg_esea_sense_out.h"

// base include



#if MAVLINK_ESEA_KNEE_XML_HASH == MAVLINK_PRIMARY_XML_HASH
# define MAVLINK_MESSAGE_INFO {MAVLINK_MESSAGE_INFO_HEARTBEAT, MAVLINK_MESSAGE_INFO_COMMAND_LONG, MAVLINK_MESSAGE_INFO_COMMAND_ACK, MAVLINK_MESSAGE_INFO_ESEA_INFO, MAVLINK_MESSAGE_INFO_ESEA_SENSE_IN, MAVLINK_MESSAGE_INFO_ESEA_SENSE_OUT}
# define MAVLINK_MESSAGE_NAMES {{ "COMMAND_ACK", 77 }, { "COMMAND_LONG", 76 }, { "ESEA_INFO", 42600 }, { "ESEA_SENSE_IN", 42601 }, { "ESEA_SENSE_OUT", 42602 }, { "HEARTBEAT", 0 }}
# if MAVLINK_COMMAND_24BIT
#  include "../mavlink_get_info.h"
# endif
#endif

#ifdef __cplusplus
}
#endif // __cplusplus
#endif // MAVLINK_ESEA_KNEE_H
