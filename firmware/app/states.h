/* States of the board and what moves it: written by `python -m esea_gen.emit.states`
 * from the table in esea_gen/emit/states.toml; do not edit.
 *
 * License: MIT. */
#ifndef ESEA_STATES_H
#define ESEA_STATES_H

#include <stdbool.h>

#define HAVE_ENUM_ESEA_STATE /* the dialect's own has an entry more */
typedef enum {
    ESEA_STATE_BOOT = 0, /* Starting. */
    ESEA_STATE_READY = 1, /* All is known; waits to be armed. */
    ESEA_STATE_REPLAY = 2, /* The host's inputs clock the tasks, one run each; drivers and own clock rest. */
    ESEA_STATE_FAULT = 3, /* A fault is latched; its number tells which. */
    ESEA_STATE_SELF_TEST = 4, /* Checks itself. */
    ESEA_STATE_UNREFERENCED = 5, /* Encoders have no zero; waits to be zeroed. */
    ESEA_STATE_ZEROING = 6, /* Takes the present angles, which must stand still, as zero. */
    ESEA_STATE_ARMED = 7, /* The motor is on, without torque; waits for a command. */
    ESEA_STATE_ACTIVE = 8, /* Follows the host's commands. */
    ESEA_STATE_LETTING_GO = 9, /* No command came in time, or disarmed while active: the torque fades to none. */
    ESEA_STATE_STOPPED = 10, /* Stopped by somebody; waits to be released. */
    ESEA_STATE_STOPPING = 11, /* Stopped by somebody while sensing is sound: the torque fades to zero, the drive follows the limb, then the motor is off. */
} ESEA_STATE;

#define HAVE_ENUM_ESEA_EVENT /* the dialect's own has an entry more */
typedef enum {
    ESEA_EVENT_STOP = 1, /* Stop, from anybody, or the stop line is open. */
    ESEA_EVENT_RELEASE = 2, /* Take the stop back. */
    ESEA_EVENT_CLEAR = 3, /* The fault has been seen to. */
    ESEA_EVENT_RESET = 4, /* Start afresh. */
    ESEA_EVENT_ZERO = 5, /* The joint is at its zero and unloaded: take the angles. */
    ESEA_EVENT_ARM = 6, /* Switch the motor on. */
    ESEA_EVENT_DISARM = 7, /* Switch the motor off, gently where it holds torque. */
    ESEA_EVENT_OFF = 8, /* A command with mode 0. */
    ESEA_EVENT_ON = 9, /* A command with mode 1 or 2. */
    ESEA_EVENT_INPUT = 10, /* An input of a task: the host clocks. */
    ESEA_EVENT_STARTED = 32, /* Memory and port are set up. */
    ESEA_EVENT_PASSED = 33, /* The self-test found nothing. */
    ESEA_EVENT_ZEROED = 34, /* The angles stood still and are taken. */
    ESEA_EVENT_NOT_ZEROED = 35, /* They did not, or an encoder cannot be used. */
    ESEA_EVENT_REFUSED = 36, /* The limits did not release. */
    ESEA_EVENT_EXPIRED = 37, /* The command's deadline has passed. */
    ESEA_EVENT_LINK_LOST = 38, /* Nothing has come from the host for too long. */
    ESEA_EVENT_FADED = 39, /* The torque has faded to none. */
    ESEA_EVENT_FAILED = 40, /* A fault was found. */
} ESEA_EVENT;

/* Times, compiled in. */
#define ESEA_DEADLINE_MS 100u /* from a command with mode 1 or 2 to the next, where it names no other time */
#define ESEA_DEADLINE_LEAST_MS 20u /* shortest that a command may name */
#define ESEA_DEADLINE_MOST_MS 1000u /* longest; whatever a command names */
#define ESEA_LINK_LOST_MS 1000u /* without anything from the host */
#define ESEA_FADE_MS 500u /* of letting go, from the torque that was set to none */
#define ESEA_STOP_FADE_MS 250u /* of a controlled stop, from the torque that was set to zero */
#define ESEA_STOP_OFF_MS 600u /* of a controlled stop, until the motor is off; from zero torque on the drive follows the limb */
#define ESEA_ZEROING_MS 200u /* in which the joint must stand still to be zeroed */
#define ESEA_COMMAND_AGE_MS 500u /* oldest that a command with a time may be; as far ahead of the clock */
#define ESEA_FRAME_MS 200u /* longest silence within a frame; what came of it is then searched for others */

/* What must hold for some transitions. */
typedef struct {
    bool drive; /* the device has a motor */
    bool encoders; /* the device has encoders with a zero */
    bool referenced; /* every encoder has a zero; true where there is none */
    bool stop_clear; /* no stop is held, and the stop line is closed */
    bool link_live; /* the host was heard of late */
    bool mode_off; /* the last command had mode 0, or none came since the motor was off */
    bool released; /* the limits have released, in the tick before */
    bool clearable; /* the fault is one of the limits' (below 100) */
} esea_guards_t;

/* Whether the board's own clock runs the tasks. */
static inline bool esea_state_computes(ESEA_STATE state)
{
    return state == ESEA_STATE_READY ||
           state == ESEA_STATE_FAULT ||
           state == ESEA_STATE_UNREFERENCED ||
           state == ESEA_STATE_ZEROING ||
           state == ESEA_STATE_ARMED ||
           state == ESEA_STATE_ACTIVE ||
           state == ESEA_STATE_LETTING_GO ||
           state == ESEA_STATE_STOPPED ||
           state == ESEA_STATE_STOPPING;
}

/* Whether it is one of the list. */
static inline bool esea_state_known(ESEA_STATE state)
{
    return state == ESEA_STATE_BOOT ||
           state == ESEA_STATE_READY ||
           state == ESEA_STATE_REPLAY ||
           state == ESEA_STATE_FAULT ||
           state == ESEA_STATE_SELF_TEST ||
           state == ESEA_STATE_UNREFERENCED ||
           state == ESEA_STATE_ZEROING ||
           state == ESEA_STATE_ARMED ||
           state == ESEA_STATE_ACTIVE ||
           state == ESEA_STATE_LETTING_GO ||
           state == ESEA_STATE_STOPPED ||
           state == ESEA_STATE_STOPPING;
}

/* Whether the motor may be on. */
static inline bool esea_state_drives(ESEA_STATE state)
{
    return state == ESEA_STATE_ARMED ||
           state == ESEA_STATE_ACTIVE ||
           state == ESEA_STATE_LETTING_GO ||
           state == ESEA_STATE_STOPPING;
}

#endif
