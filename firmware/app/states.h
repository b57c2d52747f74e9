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
    ESEA_STATE_READY = 1, /* Ready to be armed. */
    ESEA_STATE_REPLAY = 2, /* The host's inputs clock the tasks, one run each; drivers and clock are off. */
    ESEA_STATE_FAULT = 3, /* A fault is latched; its number is reported. */
    ESEA_STATE_SELF_TEST = 4, /* Runs the self-test. */
    ESEA_STATE_UNREFERENCED = 5, /* Encoders have no zero; waits to be zeroed. */
    ESEA_STATE_ZEROING = 6, /* Sets the present angles to zero; the joint must be at rest. */
    ESEA_STATE_ARMED = 7, /* The motor is on, without torque; waits for a command. */
    ESEA_STATE_ACTIVE = 8, /* Follows the host's commands. */
    ESEA_STATE_LETTING_GO = 9, /* The command expired, or disarmed while active: the torque fades to zero. */
    ESEA_STATE_STOPPED = 10, /* Stopped; waits to be released. */
    ESEA_STATE_STOPPING = 11, /* Controlled stop: the torque fades to zero, the drive follows the limb, then the motor is off. */
} ESEA_STATE;

#define HAVE_ENUM_ESEA_EVENT /* the dialect's own has an entry more */
typedef enum {
    ESEA_EVENT_STOP = 1, /* A stop from any sender, or an open stop line. */
    ESEA_EVENT_RELEASE = 2, /* Release the stop. */
    ESEA_EVENT_CLEAR = 3, /* Acknowledge the fault. */
    ESEA_EVENT_RESET = 4, /* Restart. */
    ESEA_EVENT_ZERO = 5, /* Zero the encoders: the joint is at its zero and unloaded. */
    ESEA_EVENT_ARM = 6, /* Switch the motor on. */
    ESEA_EVENT_DISARM = 7, /* Switch the motor off; torque fades first. */
    ESEA_EVENT_OFF = 8, /* A command with mode 0. */
    ESEA_EVENT_ON = 9, /* A command with mode 1 or 2. */
    ESEA_EVENT_INPUT = 10, /* An input of a task: the host clocks. */
    ESEA_EVENT_STARTED = 32, /* Memory and port are set up. */
    ESEA_EVENT_PASSED = 33, /* The self-test passed. */
    ESEA_EVENT_ZEROED = 34, /* The joint was at rest; the zeros are set. */
    ESEA_EVENT_NOT_ZEROED = 35, /* The joint moved, or an encoder cannot be used. */
    ESEA_EVENT_REFUSED = 36, /* The limits did not release. */
    ESEA_EVENT_EXPIRED = 37, /* The command's deadline has passed. */
    ESEA_EVENT_LINK_LOST = 38, /* Nothing has come from the host in time for too long. */
    ESEA_EVENT_FADED = 39, /* The torque has faded to zero. */
    ESEA_EVENT_FAILED = 40, /* A fault was detected. */
} ESEA_EVENT;

/* Times, compiled in. */
#define ESEA_DEADLINE_MS 100u /* default, from a command with mode 1 or 2 to the next */
#define ESEA_DEADLINE_LEAST_MS 20u /* shortest deadline that a command may set */
#define ESEA_DEADLINE_MOST_MS 1000u /* longest deadline that a command may set */
#define ESEA_LINK_LOST_MS 1000u /* without anything in time from the host */
#define ESEA_FADE_MS 500u /* from the set torque to zero, after an expired command or a disarm */
#define ESEA_STOP_FADE_MS 250u /* from the set torque to zero, in a controlled stop */
#define ESEA_STOP_OFF_MS 600u /* from a controlled stop to motor off; from zero torque on the drive follows the limb */
#define ESEA_ZEROING_MS 200u /* rest of the joint that zeroing needs */
#define ESEA_COMMAND_AGE_MS 500u /* largest age of a command that carries a time, or lead over the clock */
#define ESEA_FRAME_MS 200u /* longest silence within a frame; its bytes are then searched for other frames */

/* What must hold for some transitions. */
typedef struct {
    bool drive; /* the device has a motor */
    bool encoders; /* the device has encoders with a zero */
    bool referenced; /* every encoder has a zero, or there is no encoder */
    bool stop_clear; /* no stop is active, and the stop line is closed */
    bool link_live; /* something of the host has come in time recently */
    bool mode_off; /* the last command had mode 0, or there was none since the motor was off */
    bool released; /* the limits released in the last tick */
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
