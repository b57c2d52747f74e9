/** @file
 *  @brief MAVLink comm protocol generated from esea_elbow_drive.xml
 *  @see http://mavlink.org
 */
#pragma once
#ifndef MAVLINK_ESEA_ELBOW_DRIVE_H
#define MAVLINK_ESEA_ELBOW_DRIVE_H

#ifndef MAVLINK_H
    #error Wrong include order: MAVLINK_ESEA_ELBOW_DRIVE.H MUST NOT BE DIRECTLY USED. Include mavlink.h from the same directory instead or set ALL AND EVERY defines from MAVLINK.H manually accordingly, including the #define MAVLINK_H call.
#endif

#define MAVLINK_ESEA_ELBOW_DRIVE_XML_HASH -7917852882117296033

#ifdef __cplusplus
extern "C" {
#endif

// MESSAGE LENGTHS AND CRCS

#ifndef MAVLINK_MESSAGE_LENGTHS
#define MAVLINK_MESSAGE_LENGTHS {}
#endif

#ifndef MAVLINK_MESSAGE_CRCS
#define MAVLINK_MESSAGE_CRCS {{0, 50, 9, 9, 0, 0, 0}, {20, 214, 20, 20, 3, 2, 3}, {21, 159, 2, 2, 3, 0, 1}, {22, 220, 25, 25, 0, 0, 0}, {23, 168, 23, 23, 3, 4, 5}, {76, 152, 33, 33, 3, 30, 31}, {77, 143, 3, 10, 3, 8, 9}, {111, 34, 16, 16, 0, 0, 0}, {253, 83, 51, 54, 0, 0, 0}, {256, 71, 42, 42, 3, 8, 9}, {345, 209, 21, 21, 3, 2, 3}, {42600, 248, 92, 92, 0, 0, 0}, {42601, 57, 52, 52, 0, 0, 0}, {42602, 180, 168, 168, 0, 0, 0}, {42603, 172, 4, 4, 0, 0, 0}, {42604, 41, 52, 52, 0, 0, 0}, {42660, 229, 26, 26, 0, 0, 0}, {42661, 167, 32, 32, 0, 0, 0}, {42662, 182, 67, 67, 0, 0, 0}, {42663, 36, 253, 253, 0, 0, 0}, {42664, 102, 32, 32, 0, 0, 0}, {42665, 247, 244, 244, 0, 0, 0}, {42666, 84, 59, 59, 0, 0, 0}, {42667, 80, 243, 243, 0, 0, 0}, {42668, 239, 216, 216, 0, 0, 0}, {42669, 226, 16, 16, 0, 0, 0}}
#endif

#include "../protocol.h"

#define MAVLINK_ENABLED_ESEA_ELBOW_DRIVE

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
   ESEA_FAULT_NOT_ARMED=1, /* not armed since power-up or reset Cure: rearm. Found: from the first step on. | */
   ESEA_FAULT_STATE_CORRUPT=2, /* the memory of the limits was corrupt Cure: rearm; if it comes again, memory or stack is at fault: service. Found: the same step. | */
   ESEA_FAULT_TUNABLE_INVALID=3, /* a limit was not within its compiled bounds, or the range of motion was turned round Cure: prepare the coefficients again from params that are in range. Found: the same step. | */
   ESEA_FAULT_STOP=4, /* stop was requested Cure: take back every stop, then rearm. Found: the same step. | */
   ESEA_FAULT_INPUT_INVALID=5, /* an input was NaN, outside its physical range or not a whole number, or what was wanted was Cure: give finite inputs within their ranges; look at the status words of the Blocks before. Found: the same step. | */
   ESEA_FAULT_SENSING=6, /* the sensing task could not vouch for its measurements Cure: look at the encoders' status words: wiring, magnet, zero. Found: the same step; what only contradicts, as the page on limits tells. | */
   ESEA_FAULT_CONTROL_STALE=7, /* the control task delivered no new command Cure: see that the control task runs and gives finite commands. Found: 5 control periods after the last new command. | */
   ESEA_FAULT_DEFLECTION=8, /* the coupling was deflected too far Cure: unload the coupling; look for a blocked joint or a slipped encoder. Found: the same step. | */
   ESEA_FAULT_TORQUE=9, /* the interaction torque was too large Cure: unload the joint; a smaller wanted torque. Found: the same step. | */
   ESEA_FAULT_SPEED=10, /* joint or drive were too fast Cure: let the joint come to rest; a slower movement or smaller gains. Found: the same step. | */
   ESEA_FAULT_RANGE_OF_MOTION=11, /* the joint was beyond its range of motion and the margin Cure: move the joint back by hand. Found: the same step. | */
   ESEA_FAULT_ENERGY=12, /* too much energy was given to the limb within the window Cure: wait until the window has forgotten; slower or weaker movement. Found: the same step. | */
   ESEA_FAULT_CLOCK=13, /* base ticks were lost, repeated or went backward, or an old state was put back Cure: call release once for every base tick, in order; resume a state that was put back. Found: the same step. | */
   ESEA_FAULT_LATE=14, /* too many runs of a task ended after the tick at which they are released Cure: free time for the late task: see the watch's counters. Found: the twelfth late run in a row. | */
   ESEA_FAULT_COEFFICIENTS=15, /* the coefficients are not those that were prepared, or no control run has checked them yet Cure: run the control task; if it stays, prepare again: memory was overwritten. Found: the next control run and its release. | */
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
   ESEA_PARAM_ENCODER_MOTOR_ZERO_RAD=0, /* corrected angle of the encoder, times direction, where the joint is at 0: set it, then init; higher lowers the joint angle |encoder_motor.zero_rad| encdr_mtr.zero| rad| -3.1415925| 3.1415925| 0| fixed|  */
   ESEA_PARAM_ENCODER_MOTOR_ZEROED=1, /* 1 says that zero_rad comes from a calibration; 0 keeps the encoder unusable |encoder_motor.zeroed| encdr_mtr.zeroed| 1| 0| 1| 1| fixed|  */
   ESEA_PARAM_ENCODER_LOAD_ZERO_RAD=2, /* corrected angle of the encoder, times direction, where the joint is at 0: set it, then init; higher lowers the joint angle |encoder_load.zero_rad| encdr_ld.zero| rad| -3.1415925| 3.1415925| 0| fixed|  */
   ESEA_PARAM_ENCODER_LOAD_ZEROED=3, /* 1 says that zero_rad comes from a calibration; 0 keeps the encoder unusable |encoder_load.zeroed| encdr_ld.zeroed| 1| 0| 1| 1| fixed|  */
   ESEA_PARAM_VELOCITY_BANDWIDTH_HZ=4, /* bandwidth of the triple pole: higher follows faster and passes more noise |velocity.bandwidth_Hz| vlcty.bandwidth| Hz| 2| 100| 15| free|  */
   ESEA_PARAM_MOTOR_RATE_CUTOFF_HZ=5, /* cut-off: higher follows faster and passes more noise |motor_rate.cutoff_Hz| mtr_rt.cutoff| Hz| 15| 60| 30| free|  */
   ESEA_PARAM_LOAD_RATE_CUTOFF_HZ=6, /* cut-off: higher follows faster and passes more noise |load_rate.cutoff_Hz| load_rate.cutoff| Hz| 15| 60| 30| free|  */
   ESEA_PARAM_ADAPTATION_SHARE=7, /* 1: the wish is adapted; 0: it is taken as it is |adaptation.share| adaptation.share| 1| 0| 1| 0| free|  */
   ESEA_PARAM_ADAPTATION_MASS_NM=8, /* weight on the joint times its arm; 0: none hangs |adaptation.mass_Nm| adaptation.m_f00| Nm| 0| 4.46999979| 0| free|  */
   ESEA_PARAM_ADAPTATION_MASS_ANGLE_RAD=9, /* angle at which it hangs straight down |adaptation.mass_angle_rad| adpttn.mss_angl| rad| -1.56999993| 1.56999993| 0| free|  */
   ESEA_PARAM_ADAPTATION_MASS_KGM2=10, /* inertia of the mass and of what bears it |adaptation.mass_kgm2| adaptation.m_d37| kg m^2| 0| 2| 0| free|  */
   ESEA_PARAM_ADAPTATION_MASS_NMS_RAD=11, /* damping of the joint that bears it |adaptation.mass_Nms_rad| adaptation.m_787| Nm s/rad| 0| 1| 0| free|  */
   ESEA_PARAM_ADAPTATION_GAIN=12, /* model's torque over the true one, as an earlier adaptation found it |adaptation.gain| adaptation.gain| 1| 0.769230723| 1.42857134| 1| free|  */
   ESEA_PARAM_ADAPTATION_LOSS=13, /* loss that the model misses, as an earlier adaptation found it |adaptation.loss| adaptation.loss| 1| -0.399999976| 0.399999976| 0| free|  */
   ESEA_PARAM_ADAPTATION_OFFSET_NM=14, /* offset, as an earlier adaptation found it |adaptation.offset_Nm| adpttn.offset| Nm| -0.299999982| 0.299999982| 0| free|  */
   ESEA_PARAM_REFERENCE_KP_NM_RAD=15, /* stiffness: higher pulls harder to the wanted angle |reference.Kp_Nm_rad| reference.Kp| Nm/rad| 0| 3| 0| free|  */
   ESEA_PARAM_REFERENCE_KD_NMS_RAD=16, /* damping: higher resists motion other than the wanted one |reference.Kd_Nms_rad| reference.Kd| Nm s/rad| 0| 0.349999994| 0| free|  */
   ESEA_PARAM_REFERENCE_BLEND_S=17, /* time constant from the measured torque to a new law: longer is gentler |reference.blend_s| reference.blend| s| 0.0200000014| 5| 0.2| free|  */
   ESEA_PARAM_REFERENCE_TAU_RANGE_NM=18, /* largest |set torque|: may only be narrowed below the identified range |reference.tau_range_Nm| rfrnc.tau_range| Nm| 0.0447000004| 4.46999979| 4.46999979| free|  */
   ESEA_PARAM_PASSIVITY_LEAST_NMS_RAD=19, /* damping that a hand feels at least: more is calmer and less transparent |passivity.least_Nms_rad| passivity.least| Nm s/rad| 0.0100000007| 0.349999994| 0.0100000007| free|  */
   ESEA_PARAM_PASSIVITY_ENERGY_J=20, /* energy that drive and command may hold and give: less is weaker |passivity.energy_J| passivity.energy| J| 0.400000006| 4| 4| free|  */
   ESEA_PARAM_LEAD_SHARE=21, /* 1 looks ahead and smooths; 0 takes the set torque as it comes |lead.share| lead.share| 1| 0| 1| 1| free|  */
   ESEA_PARAM_INVERSE_BANDWIDTH_HZ=22, /* bandwidth of the triple pole: higher follows faster and passes more noise |inverse.bandwidth_Hz| invrs.bandwidth| Hz| 2| 100| 100| free|  */
   ESEA_PARAM_SETPOINT_BANDWIDTH_HZ=23, /* bandwidth of the triple pole: higher follows faster, lower smooths the corners |setpoint.bandwidth_Hz| stpnt.bandwidth| Hz| 2| 100| 50| free|  */
   ESEA_PARAM_LIMITS_U_MAX_NM=24, /* largest |motor command|: lower is weaker |limits.u_max_Nm| limits.u_max_Nm| Nm| 0.00221000006| 0.220999986| 0.220999986| free|  */
   ESEA_PARAM_LIMITS_U_RATE_NM_S=25, /* fastest change of the command: lower is softer |limits.u_rate_Nm_s| limits.u_rate| Nm/s| 5| 50| 50| free|  */
   ESEA_PARAM_LIMITS_TAU_MAX_NM=26, /* interaction torque that trips |limits.tau_max_Nm| limits.tau_max| Nm| 0.400000006| 8| 8| free|  */
   ESEA_PARAM_LIMITS_THETA_MAX_RAD=27, /* deflection that trips |limits.theta_max_rad| limits.theta_max| rad| 0.0149999997| 0.299999982| 0.299999982| free|  */
   ESEA_PARAM_LIMITS_ROM_MIN_RAD=28, /* joint angle below which nothing pushes further: up narrows |limits.rom_min_rad| limits.rom_min| rad| -0.149999991| 2.5| -0.149999991| free|  */
   ESEA_PARAM_LIMITS_ROM_MAX_RAD=29, /* joint angle above which nothing pushes further: down narrows |limits.rom_max_rad| limits.rom_max| rad| -0.149999991| 2.5| 2.5| free|  */
   ESEA_PARAM_LIMITS_OMEGA_MAX_RAD_S=30, /* joint or drive speed that trips |limits.omega_max_rad_s| limits.omega_max| rad/s| 0.5| 10| 10| free|  */
   ESEA_PARAM_LIMITS_ENERGY_MAX_J=31, /* energy within the window that trips |limits.energy_max_J| lmts.energy_max| J| 0.150000006| 15| 15| free|  */
   ESEA_PARAM_DRIVE_BANDWIDTH_1_S=32, /* bandwidth L of the observer: higher follows faster and passes more noise; 0 holds it |drive.bandwidth_1_s| drive.bandwidth| 1/s| 0| 18.0335312| 5| free|  */
   ESEA_PARAM_HUMAN_DECAY_S=33, /* decay of the torque's rate: longer trusts a rate longer and overshoots more |human.decay_s| human.decay_s| s| 0.0600000024| 1.5| 0.3| free|  */
   ESEA_PARAM_SET_RATE_CUTOFF_HZ=34, /* cut-off: higher follows faster and passes more noise |set_rate.cutoff_Hz| set_rate.cutoff| Hz| 15| 60| 30| free|  */
   ESEA_PARAM_SET_TREND_BANDWIDTH_HZ=35, /* bandwidth without noise: higher sees sooner where it goes |set_trend.bandwidth_Hz| st_trnd.bndwdth| Hz| 0.5| 20| 16| free|  */
   ESEA_PARAM_SET_TREND_QUIET_NM=36, /* noise that halves the bandwidth: lower is calmer, and trusts less |set_trend.quiet_Nm| set_trend.quiet| Nm| 0.00100000005| 1| 0.018| free|  */
   ESEA_PARAM_SMC_LAMBDA_1_S=37, /* slope of the surface: higher is stiffer and nearer to the drive's own modes |smc.lambda_1_s| smc.lambda_1_s| 1/s| 1| 25| 15| free|  */
   ESEA_PARAM_SMC_PHI_RAD_S=38, /* width of the boundary layer: narrower is stiffer and chatters sooner |smc.phi_rad_s| smc.phi_rad_s| rad/s| 0.00100000005| 100| 1.5| free|  */
   ESEA_PARAM_SMC_MARGIN=39, /* factor on the switching gain of (5.20); 1 is its smallest |smc.margin| smc.margin| 1| 1| 5| 1| free|  */
   ESEA_PARAM_SMC_LEAD=40, /* how many times faster than the motor's lag the torque follows; 1 takes u_a as u_c |smc.lead| smc.lead| 1| 1| 4| 2.5| free|  */
   ESEA_PARAM_SMC_LOAD_SHARE=41, /* share of the load's estimated acceleration in the set-point's acceleration |smc.load_share| smc.load_share| 1| 0| 1| 1| free|  */
   ESEA_PARAM_SMC_FRICTION_AHEAD=42, /* share of the rate wanted in the rate whose friction is compensated; 0: measured |smc.friction_ahead| smc.frctn_ahd| 1| 0| 1| 1| free|  */
   ESEA_PARAM_SMC_SOFTENING=43, /* how soft a swing of the error makes the gains; 0: they stay as they are |smc.softening| smc.softening| 1| 0| 1| 1| free|  */
   ESEA_PARAM_ENUM_END=44, /*  | */
} ESEA_PARAM;
#endif

/** @brief what is known of this sample */
#ifndef HAVE_ENUM_ESEA_ELBOW_DRIVE_ENCODER_MOTOR_STATUS
#define HAVE_ENUM_ESEA_ELBOW_DRIVE_ENCODER_MOTOR_STATUS
typedef enum ESEA_ELBOW_DRIVE_ENCODER_MOTOR_STATUS
{
   ESEA_ELBOW_DRIVE_ENCODER_MOTOR_STATUS_INPUT_INVALID=1, /* count or frame word was NaN or outside its range | */
   ESEA_ELBOW_DRIVE_ENCODER_MOTOR_STATUS_STATE_REPAIRED=2, /* the state was corrupt; the encoder was started afresh | */
   ESEA_ELBOW_DRIVE_ENCODER_MOTOR_STATUS_FRAME_ERROR=4, /* the frame's own checks say that it is wrong; angle held | */
   ESEA_ELBOW_DRIVE_ENCODER_MOTOR_STATUS_IMPLAUSIBLE_STEP=8, /* the angle moved faster than the joint can; angle held | */
   ESEA_ELBOW_DRIVE_ENCODER_MOTOR_STATUS_HELD_TOO_LONG=16, /* more bad frames in a row than may be bridged: not usable | */
   ESEA_ELBOW_DRIVE_ENCODER_MOTOR_STATUS_SETTLING=32, /* too few frames that agree since the start: not usable | */
   ESEA_ELBOW_DRIVE_ENCODER_MOTOR_STATUS_NOT_ZEROED=64, /* no calibration has set the zero: not usable | */
   ESEA_ELBOW_DRIVE_ENCODER_MOTOR_STATUS_REFERENCE_LOST=128, /* the angle jumped and stayed away, or left its range of turns: not usable until init | */
   ESEA_ELBOW_DRIVE_ENCODER_MOTOR_STATUS_ENUM_END=129, /*  | */
} ESEA_ELBOW_DRIVE_ENCODER_MOTOR_STATUS;
#endif

/** @brief what is known of this sample */
#ifndef HAVE_ENUM_ESEA_ELBOW_DRIVE_ENCODER_LOAD_STATUS
#define HAVE_ENUM_ESEA_ELBOW_DRIVE_ENCODER_LOAD_STATUS
typedef enum ESEA_ELBOW_DRIVE_ENCODER_LOAD_STATUS
{
   ESEA_ELBOW_DRIVE_ENCODER_LOAD_STATUS_INPUT_INVALID=1, /* count or frame word was NaN or outside its range | */
   ESEA_ELBOW_DRIVE_ENCODER_LOAD_STATUS_STATE_REPAIRED=2, /* the state was corrupt; the encoder was started afresh | */
   ESEA_ELBOW_DRIVE_ENCODER_LOAD_STATUS_FRAME_ERROR=4, /* the frame's own checks say that it is wrong; angle held | */
   ESEA_ELBOW_DRIVE_ENCODER_LOAD_STATUS_IMPLAUSIBLE_STEP=8, /* the angle moved faster than the joint can; angle held | */
   ESEA_ELBOW_DRIVE_ENCODER_LOAD_STATUS_HELD_TOO_LONG=16, /* more bad frames in a row than may be bridged: not usable | */
   ESEA_ELBOW_DRIVE_ENCODER_LOAD_STATUS_SETTLING=32, /* too few frames that agree since the start: not usable | */
   ESEA_ELBOW_DRIVE_ENCODER_LOAD_STATUS_NOT_ZEROED=64, /* no calibration has set the zero: not usable | */
   ESEA_ELBOW_DRIVE_ENCODER_LOAD_STATUS_REFERENCE_LOST=128, /* the angle jumped and stayed away, or left its range of turns: not usable until init | */
   ESEA_ELBOW_DRIVE_ENCODER_LOAD_STATUS_ENUM_END=129, /*  | */
} ESEA_ELBOW_DRIVE_ENCODER_LOAD_STATUS;
#endif

/** @brief what is known of this sample */
#ifndef HAVE_ENUM_ESEA_ELBOW_DRIVE_JOINT_STATUS
#define HAVE_ENUM_ESEA_ELBOW_DRIVE_JOINT_STATUS
typedef enum ESEA_ELBOW_DRIVE_JOINT_STATUS
{
   ESEA_ELBOW_DRIVE_JOINT_STATUS_INPUT_INVALID=1, /* an angle was NaN or outside its range | */
   ESEA_ELBOW_DRIVE_JOINT_STATUS_ENCODER_UNUSABLE=2, /* an encoder says that its angle cannot be used | */
   ESEA_ELBOW_DRIVE_JOINT_STATUS_DEFLECTION_OUTSIDE=4, /* the deflection is beyond its physical range and was clipped | */
   ESEA_ELBOW_DRIVE_JOINT_STATUS_CONTRADICTED=8, /* another encoder or the motor's torque says otherwise, or has not been compared yet | */
   ESEA_ELBOW_DRIVE_JOINT_STATUS_ENUM_END=9, /*  | */
} ESEA_ELBOW_DRIVE_JOINT_STATUS;
#endif

/** @brief what is known of this sample */
#ifndef HAVE_ENUM_ESEA_ELBOW_DRIVE_VELOCITY_STATUS
#define HAVE_ENUM_ESEA_ELBOW_DRIVE_VELOCITY_STATUS
typedef enum ESEA_ELBOW_DRIVE_VELOCITY_STATUS
{
   ESEA_ELBOW_DRIVE_VELOCITY_STATUS_INPUT_INVALID=1, /* the deflection was NaN or outside its range; the last estimate is held | */
   ESEA_ELBOW_DRIVE_VELOCITY_STATUS_STATE_REPAIRED=2, /* the state was corrupt; the observer was started afresh | */
   ESEA_ELBOW_DRIVE_VELOCITY_STATUS_RATE_CLIPPED=4, /* the estimate was clipped at the rate's physical range | */
   ESEA_ELBOW_DRIVE_VELOCITY_STATUS_ENUM_END=5, /*  | */
} ESEA_ELBOW_DRIVE_VELOCITY_STATUS;
#endif

/** @brief what is known of this sample */
#ifndef HAVE_ENUM_ESEA_ELBOW_DRIVE_SENSOR_STATUS
#define HAVE_ENUM_ESEA_ELBOW_DRIVE_SENSOR_STATUS
typedef enum ESEA_ELBOW_DRIVE_SENSOR_STATUS
{
   ESEA_ELBOW_DRIVE_SENSOR_STATUS_INPUT_INVALID=1, /* an input was NaN or outside its physical range; the last deflection is held | */
   ESEA_ELBOW_DRIVE_SENSOR_STATUS_STATE_REPAIRED=2, /* the state was corrupt; the model was started afresh | */
   ESEA_ELBOW_DRIVE_SENSOR_STATUS_THETA_OUTSIDE=4, /* |deflection| is outside the identified domain | */
   ESEA_ELBOW_DRIVE_SENSOR_STATUS_RATE_OUTSIDE=8, /* |deflection rate| is outside the identified domain | */
   ESEA_ELBOW_DRIVE_SENSOR_STATUS_TORQUE_OUTSIDE=16, /* |torque| is above full scale | */
   ESEA_ELBOW_DRIVE_SENSOR_STATUS_STEP_CLIPPED=32, /* deflection jumped by more than its rate allows; clipped | */
   ESEA_ELBOW_DRIVE_SENSOR_STATUS_RATE_TORQUE_CLIPPED=64, /* the Maxwell element's torque was clipped at its limit | */
   ESEA_ELBOW_DRIVE_SENSOR_STATUS_ENUM_END=65, /*  | */
} ESEA_ELBOW_DRIVE_SENSOR_STATUS;
#endif

/** @brief what is known of this sample */
#ifndef HAVE_ENUM_ESEA_ELBOW_DRIVE_MOTOR_RATE_STATUS
#define HAVE_ENUM_ESEA_ELBOW_DRIVE_MOTOR_RATE_STATUS
typedef enum ESEA_ELBOW_DRIVE_MOTOR_RATE_STATUS
{
   ESEA_ELBOW_DRIVE_MOTOR_RATE_STATUS_INPUT_INVALID=1, /* the angle was NaN or outside its range; the rate is held | */
   ESEA_ELBOW_DRIVE_MOTOR_RATE_STATUS_STATE_REPAIRED=2, /* the state was corrupt; the filter was started afresh | */
   ESEA_ELBOW_DRIVE_MOTOR_RATE_STATUS_STEP_CLIPPED=4, /* the angle jumped by more than a twentieth of its range; clipped | */
   ESEA_ELBOW_DRIVE_MOTOR_RATE_STATUS_RATE_CLIPPED=8, /* the filtered rate was clipped at its physical range | */
   ESEA_ELBOW_DRIVE_MOTOR_RATE_STATUS_ENUM_END=9, /*  | */
} ESEA_ELBOW_DRIVE_MOTOR_RATE_STATUS;
#endif

/** @brief what is known of this sample */
#ifndef HAVE_ENUM_ESEA_ELBOW_DRIVE_LOAD_RATE_STATUS
#define HAVE_ENUM_ESEA_ELBOW_DRIVE_LOAD_RATE_STATUS
typedef enum ESEA_ELBOW_DRIVE_LOAD_RATE_STATUS
{
   ESEA_ELBOW_DRIVE_LOAD_RATE_STATUS_INPUT_INVALID=1, /* the angle was NaN or outside its range; the rate is held | */
   ESEA_ELBOW_DRIVE_LOAD_RATE_STATUS_STATE_REPAIRED=2, /* the state was corrupt; the filter was started afresh | */
   ESEA_ELBOW_DRIVE_LOAD_RATE_STATUS_STEP_CLIPPED=4, /* the angle jumped by more than a twentieth of its range; clipped | */
   ESEA_ELBOW_DRIVE_LOAD_RATE_STATUS_RATE_CLIPPED=8, /* the filtered rate was clipped at its physical range | */
   ESEA_ELBOW_DRIVE_LOAD_RATE_STATUS_ENUM_END=9, /*  | */
} ESEA_ELBOW_DRIVE_LOAD_RATE_STATUS;
#endif

/** @brief what is known of this sample */
#ifndef HAVE_ENUM_ESEA_ELBOW_DRIVE_ENCODER_GEAR_STATUS
#define HAVE_ENUM_ESEA_ELBOW_DRIVE_ENCODER_GEAR_STATUS
typedef enum ESEA_ELBOW_DRIVE_ENCODER_GEAR_STATUS
{
   ESEA_ELBOW_DRIVE_ENCODER_GEAR_STATUS_INPUT_INVALID=1, /* count or frame word was NaN or outside its range | */
   ESEA_ELBOW_DRIVE_ENCODER_GEAR_STATUS_STATE_REPAIRED=2, /* the state was corrupt; the encoder was started afresh | */
   ESEA_ELBOW_DRIVE_ENCODER_GEAR_STATUS_FRAME_ERROR=4, /* the frame's own checks say that it is wrong; angle held | */
   ESEA_ELBOW_DRIVE_ENCODER_GEAR_STATUS_IMPLAUSIBLE_STEP=8, /* the shaft moved faster than it can; angle held | */
   ESEA_ELBOW_DRIVE_ENCODER_GEAR_STATUS_NOT_USABLE=16, /* no frame yet, or more were bad than may be bridged: starts again | */
   ESEA_ELBOW_DRIVE_ENCODER_GEAR_STATUS_RANGE_LEFT=32, /* turned by more than the joint's whole range | */
   ESEA_ELBOW_DRIVE_ENCODER_GEAR_STATUS_ENUM_END=33, /*  | */
} ESEA_ELBOW_DRIVE_ENCODER_GEAR_STATUS;
#endif

/** @brief what is known of it */
#ifndef HAVE_ENUM_ESEA_ELBOW_DRIVE_ADAPTATION_STATUS
#define HAVE_ENUM_ESEA_ELBOW_DRIVE_ADAPTATION_STATUS
typedef enum ESEA_ELBOW_DRIVE_ADAPTATION_STATUS
{
   ESEA_ELBOW_DRIVE_ADAPTATION_STATUS_INPUT_INVALID=1, /* an input was NaN or outside its range; nothing is learnt | */
   ESEA_ELBOW_DRIVE_ADAPTATION_STATUS_STATE_REPAIRED=2, /* the state was corrupt; what was learnt is lost | */
   ESEA_ELBOW_DRIVE_ADAPTATION_STATUS_LEARNS=4, /* the known mass moves: gain, loss and offset are learnt | */
   ESEA_ELBOW_DRIVE_ADAPTATION_STATUS_AT_BOUND=8, /* what would be learnt lies beyond its bound | */
   ESEA_ELBOW_DRIVE_ADAPTATION_STATUS_IMPLAUSIBLE=16, /* no rubber misses the known torque by so much: nothing is learnt | */
   ESEA_ELBOW_DRIVE_ADAPTATION_STATUS_ENUM_END=17, /*  | */
} ESEA_ELBOW_DRIVE_ADAPTATION_STATUS;
#endif

/** @brief what is known of this set torque */
#ifndef HAVE_ENUM_ESEA_ELBOW_DRIVE_REFERENCE_STATUS
#define HAVE_ENUM_ESEA_ELBOW_DRIVE_REFERENCE_STATUS
typedef enum ESEA_ELBOW_DRIVE_REFERENCE_STATUS
{
   ESEA_ELBOW_DRIVE_REFERENCE_STATUS_INPUT_INVALID=1, /* an input was NaN or outside its range; the limits latch | */
   ESEA_ELBOW_DRIVE_REFERENCE_STATUS_STATE_REPAIRED=2, /* the state was corrupt; the limits latch | */
   ESEA_ELBOW_DRIVE_REFERENCE_STATUS_CLIPPED=4, /* the set torque was clipped at tau_range_Nm | */
   ESEA_ELBOW_DRIVE_REFERENCE_STATUS_ENTERED=8, /* a law took over in this step, from where the torque was | */
   ESEA_ELBOW_DRIVE_REFERENCE_STATUS_ENUM_END=9, /*  | */
} ESEA_ELBOW_DRIVE_REFERENCE_STATUS;
#endif

/** @brief what is known of this step */
#ifndef HAVE_ENUM_ESEA_ELBOW_DRIVE_PASSIVITY_STATUS
#define HAVE_ENUM_ESEA_ELBOW_DRIVE_PASSIVITY_STATUS
typedef enum ESEA_ELBOW_DRIVE_PASSIVITY_STATUS
{
   ESEA_ELBOW_DRIVE_PASSIVITY_STATUS_INPUT_INVALID=1, /* an input was NaN or outside its range; the command is 0 | */
   ESEA_ELBOW_DRIVE_PASSIVITY_STATUS_STATE_REPAIRED=2, /* the state was corrupt, all is forgotten: the limits latch | */
   ESEA_ELBOW_DRIVE_PASSIVITY_STATUS_DAMPED=4, /* damping is added to what is wanted | */
   ESEA_ELBOW_DRIVE_PASSIVITY_STATUS_COMMAND_CLOSED=8, /* the command was cut: the drive holds as much as it may give | */
   ESEA_ELBOW_DRIVE_PASSIVITY_STATUS_FAST=16, /* the drive is faster than the bound reckons with | */
   ESEA_ELBOW_DRIVE_PASSIVITY_STATUS_ENUM_END=17, /*  | */
} ESEA_ELBOW_DRIVE_PASSIVITY_STATUS;
#endif

/** @brief what is known of it */
#ifndef HAVE_ENUM_ESEA_ELBOW_DRIVE_LEAD_STATUS
#define HAVE_ENUM_ESEA_ELBOW_DRIVE_LEAD_STATUS
typedef enum ESEA_ELBOW_DRIVE_LEAD_STATUS
{
   ESEA_ELBOW_DRIVE_LEAD_STATUS_INPUT_INVALID=1, /* an input was NaN or outside its range; not led | */
   ESEA_ELBOW_DRIVE_LEAD_STATUS_STATE_REPAIRED=2, /* the state was corrupt; started afresh | */
   ESEA_ELBOW_DRIVE_LEAD_STATUS_ENUM_END=3, /*  | */
} ESEA_ELBOW_DRIVE_LEAD_STATUS;
#endif

/** @brief what is known of this set-point */
#ifndef HAVE_ENUM_ESEA_ELBOW_DRIVE_INVERSE_STATUS
#define HAVE_ENUM_ESEA_ELBOW_DRIVE_INVERSE_STATUS
typedef enum ESEA_ELBOW_DRIVE_INVERSE_STATUS
{
   ESEA_ELBOW_DRIVE_INVERSE_STATUS_INPUT_INVALID=1, /* an input was NaN or outside its range; the set-point is held | */
   ESEA_ELBOW_DRIVE_INVERSE_STATUS_STATE_REPAIRED=2, /* the state was corrupt; the model was started afresh | */
   ESEA_ELBOW_DRIVE_INVERSE_STATUS_THETA_OUTSIDE=4, /* |set-point| is outside the identified domain | */
   ESEA_ELBOW_DRIVE_INVERSE_STATUS_RATE_OUTSIDE=8, /* |rate of the set-point| is outside the identified domain | */
   ESEA_ELBOW_DRIVE_INVERSE_STATUS_TORQUE_OUTSIDE=16, /* |request| is above full scale | */
   ESEA_ELBOW_DRIVE_INVERSE_STATUS_REQUEST_CLAMPED=32, /* the request cannot be reached; the set-point stands at its limit | */
   ESEA_ELBOW_DRIVE_INVERSE_STATUS_STEP_CLIPPED=64, /* the set-point jumps by more than its rate allows, or the memory of its rate or of the model's rate torque is at its range; clipped | */
   ESEA_ELBOW_DRIVE_INVERSE_STATUS_NOT_CONVERGED=128, /* the model's torque at the set-point misses the request | */
   ESEA_ELBOW_DRIVE_INVERSE_STATUS_ENUM_END=129, /*  | */
} ESEA_ELBOW_DRIVE_INVERSE_STATUS;
#endif

/** @brief what is known of this set-point */
#ifndef HAVE_ENUM_ESEA_ELBOW_DRIVE_SETPOINT_STATUS
#define HAVE_ENUM_ESEA_ELBOW_DRIVE_SETPOINT_STATUS
typedef enum ESEA_ELBOW_DRIVE_SETPOINT_STATUS
{
   ESEA_ELBOW_DRIVE_SETPOINT_STATUS_INPUT_INVALID=1, /* the set-point was NaN or outside its range; it is held | */
   ESEA_ELBOW_DRIVE_SETPOINT_STATUS_STATE_REPAIRED=2, /* the state was corrupt; started afresh | */
   ESEA_ELBOW_DRIVE_SETPOINT_STATUS_RATE_CLIPPED=4, /* the rate, or the memory of the set-point, was clipped | */
   ESEA_ELBOW_DRIVE_SETPOINT_STATUS_ACCELERATION_CLIPPED=8, /* the acceleration was clipped | */
   ESEA_ELBOW_DRIVE_SETPOINT_STATUS_ENUM_END=9, /*  | */
} ESEA_ELBOW_DRIVE_SETPOINT_STATUS;
#endif

/** @brief what is known of it */
#ifndef HAVE_ENUM_ESEA_ELBOW_DRIVE_SMOOTH_STATUS
#define HAVE_ENUM_ESEA_ELBOW_DRIVE_SMOOTH_STATUS
typedef enum ESEA_ELBOW_DRIVE_SMOOTH_STATUS
{
   ESEA_ELBOW_DRIVE_SMOOTH_STATUS_INPUT_INVALID=1, /* an input was NaN or outside its range; not smoothed | */
   ESEA_ELBOW_DRIVE_SMOOTH_STATUS_STATE_REPAIRED=2, /* the state was corrupt; started afresh | */
   ESEA_ELBOW_DRIVE_SMOOTH_STATUS_ENUM_END=3, /*  | */
} ESEA_ELBOW_DRIVE_SMOOTH_STATUS;
#endif

/** @brief which limits act, and what holds the latch */
#ifndef HAVE_ENUM_ESEA_ELBOW_DRIVE_LIMITS_STATUS
#define HAVE_ENUM_ESEA_ELBOW_DRIVE_LIMITS_STATUS
typedef enum ESEA_ELBOW_DRIVE_LIMITS_STATUS
{
   ESEA_ELBOW_DRIVE_LIMITS_STATUS_INPUT_INVALID=1, /* an input was NaN, outside its physical range or not a whole number, or what was wanted was | */
   ESEA_ELBOW_DRIVE_LIMITS_STATUS_STATE_REPAIRED=2, /* the state was corrupt; the latch was closed afresh | */
   ESEA_ELBOW_DRIVE_LIMITS_STATUS_TUNABLE_INVALID=4, /* a limit was not within its compiled bounds, or the range of motion was turned round | */
   ESEA_ELBOW_DRIVE_LIMITS_STATUS_STOPPED=8, /* stop is requested now | */
   ESEA_ELBOW_DRIVE_LIMITS_STATUS_SENSING_LOST=16, /* the sensing task could not vouch for its measurements | */
   ESEA_ELBOW_DRIVE_LIMITS_STATUS_CONTROL_STALE=32, /* the control task has delivered no new command for too long | */
   ESEA_ELBOW_DRIVE_LIMITS_STATUS_DEFLECTION=64, /* the deflection is beyond its limit | */
   ESEA_ELBOW_DRIVE_LIMITS_STATUS_INTERACTION_TORQUE=128, /* the interaction torque is beyond its limit | */
   ESEA_ELBOW_DRIVE_LIMITS_STATUS_SPEED=256, /* joint or drive are faster than their limit | */
   ESEA_ELBOW_DRIVE_LIMITS_STATUS_RANGE_OF_MOTION=512, /* the joint is beyond its range of motion and the margin | */
   ESEA_ELBOW_DRIVE_LIMITS_STATUS_ENERGY=1024, /* the energy given to the limb within the window is beyond its limit | */
   ESEA_ELBOW_DRIVE_LIMITS_STATUS_TORQUE_CLIPPED=2048, /* the command was clipped at the largest motor torque | */
   ESEA_ELBOW_DRIVE_LIMITS_STATUS_RATE_LIMITED=4096, /* the command changed faster than allowed | */
   ESEA_ELBOW_DRIVE_LIMITS_STATUS_ROM_LOW=8192, /* pushing towards the lower end was held back | */
   ESEA_ELBOW_DRIVE_LIMITS_STATUS_ROM_HIGH=16384, /* pushing towards the upper end was held back | */
   ESEA_ELBOW_DRIVE_LIMITS_STATUS_SPEED_LIMITED=32768, /* pushing on at high speed was held back | */
   ESEA_ELBOW_DRIVE_LIMITS_STATUS_REARM_REFUSED=65536, /* a rearm request came, but not all its conditions were met | */
   ESEA_ELBOW_DRIVE_LIMITS_STATUS_FAULT_LATCHED=131072, /* the motor command is held at zero; fault tells the first reason | */
   ESEA_ELBOW_DRIVE_LIMITS_STATUS_CLOCK=262144, /* base ticks were lost, repeated or went backward | */
   ESEA_ELBOW_DRIVE_LIMITS_STATUS_LATE=524288, /* too many runs of a task ended after the tick at which they are released | */
   ESEA_ELBOW_DRIVE_LIMITS_STATUS_COEFFICIENTS=1048576, /* the coefficients are not those that were prepared, or no control run has checked them yet | */
   ESEA_ELBOW_DRIVE_LIMITS_STATUS_ENUM_END=1048577, /*  | */
} ESEA_ELBOW_DRIVE_LIMITS_STATUS;
#endif

/** @brief what is known of this estimate */
#ifndef HAVE_ENUM_ESEA_ELBOW_DRIVE_DRIVE_STATUS
#define HAVE_ENUM_ESEA_ELBOW_DRIVE_DRIVE_STATUS
typedef enum ESEA_ELBOW_DRIVE_DRIVE_STATUS
{
   ESEA_ELBOW_DRIVE_DRIVE_STATUS_INPUT_INVALID=1, /* an input was NaN or outside its range; d4 is held | */
   ESEA_ELBOW_DRIVE_DRIVE_STATUS_STATE_REPAIRED=2, /* the state was corrupt; the observer was started afresh | */
   ESEA_ELBOW_DRIVE_DRIVE_STATUS_CLIPPED=4, /* the estimate was clipped at its range | */
   ESEA_ELBOW_DRIVE_DRIVE_STATUS_ENUM_END=5, /*  | */
} ESEA_ELBOW_DRIVE_DRIVE_STATUS;
#endif

/** @brief what is known of this estimate */
#ifndef HAVE_ENUM_ESEA_ELBOW_DRIVE_GEAR_STATUS
#define HAVE_ENUM_ESEA_ELBOW_DRIVE_GEAR_STATUS
typedef enum ESEA_ELBOW_DRIVE_GEAR_STATUS
{
   ESEA_ELBOW_DRIVE_GEAR_STATUS_INPUT_INVALID=1, /* an input was NaN or outside its range; d4 is held | */
   ESEA_ELBOW_DRIVE_GEAR_STATUS_STATE_REPAIRED=2, /* the state was corrupt; the observer was started afresh | */
   ESEA_ELBOW_DRIVE_GEAR_STATUS_CLIPPED=4, /* the estimate was clipped at its range | */
   ESEA_ELBOW_DRIVE_GEAR_STATUS_ENUM_END=5, /*  | */
} ESEA_ELBOW_DRIVE_GEAR_STATUS;
#endif

/** @brief what is known of this estimate */
#ifndef HAVE_ENUM_ESEA_ELBOW_DRIVE_HUMAN_STATUS
#define HAVE_ENUM_ESEA_ELBOW_DRIVE_HUMAN_STATUS
typedef enum ESEA_ELBOW_DRIVE_HUMAN_STATUS
{
   ESEA_ELBOW_DRIVE_HUMAN_STATUS_INPUT_INVALID=1, /* an input was NaN or outside its range; the observer predicts without correction | */
   ESEA_ELBOW_DRIVE_HUMAN_STATUS_STATE_REPAIRED=2, /* the state was corrupt; the observer was started afresh | */
   ESEA_ELBOW_DRIVE_HUMAN_STATUS_OMEGA_CLIPPED=4, /* the load side's rate was clipped at its range | */
   ESEA_ELBOW_DRIVE_HUMAN_STATUS_TORQUE_CLIPPED=8, /* the torque of the person was clipped at its range | */
   ESEA_ELBOW_DRIVE_HUMAN_STATUS_TORQUE_RATE_CLIPPED=16, /* the rate of that torque was clipped at its range | */
   ESEA_ELBOW_DRIVE_HUMAN_STATUS_ANGLE_CLIPPED=32, /* the angle was predicted past its range, without a valid sample; it rests there | */
   ESEA_ELBOW_DRIVE_HUMAN_STATUS_ENUM_END=33, /*  | */
} ESEA_ELBOW_DRIVE_HUMAN_STATUS;
#endif

/** @brief what is known of this sample */
#ifndef HAVE_ENUM_ESEA_ELBOW_DRIVE_SET_RATE_STATUS
#define HAVE_ENUM_ESEA_ELBOW_DRIVE_SET_RATE_STATUS
typedef enum ESEA_ELBOW_DRIVE_SET_RATE_STATUS
{
   ESEA_ELBOW_DRIVE_SET_RATE_STATUS_INPUT_INVALID=1, /* the angle was NaN or outside its range; the rate is held | */
   ESEA_ELBOW_DRIVE_SET_RATE_STATUS_STATE_REPAIRED=2, /* the state was corrupt; the filter was started afresh | */
   ESEA_ELBOW_DRIVE_SET_RATE_STATUS_STEP_CLIPPED=4, /* the angle jumped by more than a twentieth of its range; clipped | */
   ESEA_ELBOW_DRIVE_SET_RATE_STATUS_RATE_CLIPPED=8, /* the filtered rate was clipped at its physical range | */
   ESEA_ELBOW_DRIVE_SET_RATE_STATUS_ENUM_END=9, /*  | */
} ESEA_ELBOW_DRIVE_SET_RATE_STATUS;
#endif

/** @brief what is known of it */
#ifndef HAVE_ENUM_ESEA_ELBOW_DRIVE_SET_TREND_STATUS
#define HAVE_ENUM_ESEA_ELBOW_DRIVE_SET_TREND_STATUS
typedef enum ESEA_ELBOW_DRIVE_SET_TREND_STATUS
{
   ESEA_ELBOW_DRIVE_SET_TREND_STATUS_INPUT_INVALID=1, /* the input was NaN or outside its range; the last one counts | */
   ESEA_ELBOW_DRIVE_SET_TREND_STATUS_STATE_REPAIRED=2, /* the state was corrupt; started afresh | */
   ESEA_ELBOW_DRIVE_SET_TREND_STATUS_CLIPPED=4, /* rate or acceleration is at its range | */
   ESEA_ELBOW_DRIVE_SET_TREND_STATUS_ENUM_END=5, /*  | */
} ESEA_ELBOW_DRIVE_SET_TREND_STATUS;
#endif

/** @brief what is known of this command */
#ifndef HAVE_ENUM_ESEA_ELBOW_DRIVE_SMC_STATUS
#define HAVE_ENUM_ESEA_ELBOW_DRIVE_SMC_STATUS
typedef enum ESEA_ELBOW_DRIVE_SMC_STATUS
{
   ESEA_ELBOW_DRIVE_SMC_STATUS_INPUT_INVALID=1, /* an input was NaN or outside its range; no torque asked for | */
   ESEA_ELBOW_DRIVE_SMC_STATUS_STATE_REPAIRED=2, /* the state was corrupt; no torque asked for in this step | */
   ESEA_ELBOW_DRIVE_SMC_STATUS_SATURATED=4, /* the command was clipped at the motor's limit | */
   ESEA_ELBOW_DRIVE_SMC_STATUS_LAYER_LEFT=8, /* |s| is beyond the boundary layer | */
   ESEA_ELBOW_DRIVE_SMC_STATUS_INTEGRAL_RESTS=16, /* the command is held back, or the integral is at its range: it does not grow | */
   ESEA_ELBOW_DRIVE_SMC_STATUS_ACTIVE=32, /* the controller acts | */
   ESEA_ELBOW_DRIVE_SMC_STATUS_ENTERED=64, /* the controller took over in this step, from the applied command | */
   ESEA_ELBOW_DRIVE_SMC_STATUS_SOFTENED=128, /* the error swings, or did so lately: the gains are softer | */
   ESEA_ELBOW_DRIVE_SMC_STATUS_ENUM_END=129, /*  | */
} ESEA_ELBOW_DRIVE_SMC_STATUS;
#endif

/** @brief what is known of this sample */
#ifndef HAVE_ENUM_ESEA_ELBOW_DRIVE_REDUNDANCY_STATUS
#define HAVE_ENUM_ESEA_ELBOW_DRIVE_REDUNDANCY_STATUS
typedef enum ESEA_ELBOW_DRIVE_REDUNDANCY_STATUS
{
   ESEA_ELBOW_DRIVE_REDUNDANCY_STATUS_INPUT_INVALID=1, /* an input was NaN or outside its range | */
   ESEA_ELBOW_DRIVE_REDUNDANCY_STATUS_STATE_REPAIRED=2, /* the state was corrupt, the zero is lost: the limits latch | */
   ESEA_ELBOW_DRIVE_REDUNDANCY_STATUS_NOT_COMPARED=4, /* an encoder cannot be used: nothing is vouched for | */
   ESEA_ELBOW_DRIVE_REDUNDANCY_STATUS_ANGLES_PART=8, /* the motor's encoder and the motor-side one contradict each other | */
   ESEA_ELBOW_DRIVE_REDUNDANCY_STATUS_TORQUES_PART=16, /* the drive moves otherwise than motor and coupling would move it | */
   ESEA_ELBOW_DRIVE_REDUNDANCY_STATUS_ENUM_END=17, /*  | */
} ESEA_ELBOW_DRIVE_REDUNDANCY_STATUS;
#endif

/** @brief what is known of this command */
#ifndef HAVE_ENUM_ESEA_ELBOW_DRIVE_STAMP_STATUS
#define HAVE_ENUM_ESEA_ELBOW_DRIVE_STAMP_STATUS
typedef enum ESEA_ELBOW_DRIVE_STAMP_STATUS
{
   ESEA_ELBOW_DRIVE_STAMP_STATUS_INPUT_INVALID=1, /* the command was NaN or outside its range; 0 is passed on | */
   ESEA_ELBOW_DRIVE_STAMP_STATUS_STATE_REPAIRED=2, /* the count was corrupt; it starts again | */
   ESEA_ELBOW_DRIVE_STAMP_STATUS_ENUM_END=3, /*  | */
} ESEA_ELBOW_DRIVE_STAMP_STATUS;
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
#include "./mavlink_msg_esea_control_in.h"
#include "./mavlink_msg_esea_control_out.h"
#include "./mavlink_msg_esea_clock.h"
#include "./mavlink_msg_esea_stream.h"
#include "./mavlink_msg_esea_data.h"
#include "./mavlink_msg_esea_traffic.h"
#include "./mavlink_msg_esea_key.h"
#include "./mavlink_msg_esea_kept.h"
#include "./mavlink_msg_esea_blackbox.h"
#include "./mavlink_msg_esea_life.h"
#include "./mavlink_msg_esea_stamp.h"
#include "./mavlink_msg_esea_wanted.h"

// base include



#if MAVLINK_ESEA_ELBOW_DRIVE_XML_HASH == MAVLINK_PRIMARY_XML_HASH
# define MAVLINK_MESSAGE_INFO {MAVLINK_MESSAGE_INFO_HEARTBEAT, MAVLINK_MESSAGE_INFO_PARAM_REQUEST_READ, MAVLINK_MESSAGE_INFO_PARAM_REQUEST_LIST, MAVLINK_MESSAGE_INFO_PARAM_VALUE, MAVLINK_MESSAGE_INFO_PARAM_SET, MAVLINK_MESSAGE_INFO_COMMAND_LONG, MAVLINK_MESSAGE_INFO_COMMAND_ACK, MAVLINK_MESSAGE_INFO_TIMESYNC, MAVLINK_MESSAGE_INFO_STATUSTEXT, MAVLINK_MESSAGE_INFO_SETUP_SIGNING, MAVLINK_MESSAGE_INFO_PARAM_ERROR, MAVLINK_MESSAGE_INFO_ESEA_INFO, MAVLINK_MESSAGE_INFO_ESEA_SENSE_IN, MAVLINK_MESSAGE_INFO_ESEA_SENSE_OUT, MAVLINK_MESSAGE_INFO_ESEA_CONTROL_IN, MAVLINK_MESSAGE_INFO_ESEA_CONTROL_OUT, MAVLINK_MESSAGE_INFO_ESEA_WANTED, MAVLINK_MESSAGE_INFO_ESEA_CLOCK, MAVLINK_MESSAGE_INFO_ESEA_STREAM, MAVLINK_MESSAGE_INFO_ESEA_DATA, MAVLINK_MESSAGE_INFO_ESEA_TRAFFIC, MAVLINK_MESSAGE_INFO_ESEA_KEY, MAVLINK_MESSAGE_INFO_ESEA_KEPT, MAVLINK_MESSAGE_INFO_ESEA_BLACKBOX, MAVLINK_MESSAGE_INFO_ESEA_LIFE, MAVLINK_MESSAGE_INFO_ESEA_STAMP}
# define MAVLINK_MESSAGE_NAMES {{ "COMMAND_ACK", 77 }, { "COMMAND_LONG", 76 }, { "ESEA_BLACKBOX", 42667 }, { "ESEA_CLOCK", 42661 }, { "ESEA_CONTROL_IN", 42603 }, { "ESEA_CONTROL_OUT", 42604 }, { "ESEA_DATA", 42663 }, { "ESEA_INFO", 42600 }, { "ESEA_KEPT", 42666 }, { "ESEA_KEY", 42665 }, { "ESEA_LIFE", 42668 }, { "ESEA_SENSE_IN", 42601 }, { "ESEA_SENSE_OUT", 42602 }, { "ESEA_STAMP", 42669 }, { "ESEA_STREAM", 42662 }, { "ESEA_TRAFFIC", 42664 }, { "ESEA_WANTED", 42660 }, { "HEARTBEAT", 0 }, { "PARAM_ERROR", 345 }, { "PARAM_REQUEST_LIST", 21 }, { "PARAM_REQUEST_READ", 20 }, { "PARAM_SET", 23 }, { "PARAM_VALUE", 22 }, { "SETUP_SIGNING", 256 }, { "STATUSTEXT", 253 }, { "TIMESYNC", 111 }}
# if MAVLINK_COMMAND_24BIT
#  include "../mavlink_get_info.h"
# endif
#endif

#ifdef __cplusplus
}
#endif // __cplusplus
#endif // MAVLINK_ESEA_ELBOW_DRIVE_H
