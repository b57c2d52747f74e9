/* The application: what the board does between its hardware and the generated control code.
 *
 *   machine.c   state after an event
 *   schedule.c  the board's clock: base tick, tasks, motor, deadlines
 *   link.c      frames in, and the main loop
 *   start.c     power on
 *   app.c       self-test, events, faults
 *   send.c      frames out
 *   key.c       complete state for the next ticks, for a log
 *   life.c      use of the couplings
 *   reader.c    frames from bytes
 *   streams.c, parameters.c, signing.c   streams, parameters, signatures of commands
 *
 * There is no control mathematics here; that is in the generated files.  The caller owns all memory,
 * and any number of instances may run side by side.
 *
 * Who calls what: esea_app_tick from the tick's interrupt, esea_app_background from the lowest one,
 * esea_app_poll from the main loop.  A higher one may come between any two instructions of a lower.
 * The state and the command change in the tick, or with interrupts disabled.
 *
 * License: MIT. */
#ifndef ESEA_APP_H
#define ESEA_APP_H

#include <stdint.h>

#include "blackbox.h"
#include "machine.h"
#include "port.h"
#include "store.h"
#include ESEA_LINK_HEADER /* the device's binding, esea_<device>_link.h: the build names it */
#include "wire.h"

#define ESEA_FIRST_BOARD_FAULT 101 /* below: the limits' */
#define ESEA_RUNS_KEPT 4u          /* runs of a task that may wait to be sent; a power of two */
#define ESEA_SIDES 2u              /* a task's input and output */

/* One run of a task, to be sent. */
typedef struct {
    uint32_t tick, step_ticks;
    bool send[ESEA_SIDES];
    esea_link_in_t in;
    esea_link_out_t out;
} esea_run_t;

/* A task on the own clock.  Its runs write `head`, the main loop `tail`; both run free. */
typedef struct {
    volatile bool due; /* of a slower task: asked for, until it has ended */
    uint32_t due_tick;
    uint64_t due_time;
    uint32_t interval[ESEA_SIDES]; /* base ticks from one that is sent to the next; 0: none */
    volatile uint32_t head, tail;
    esea_run_t runs[ESEA_RUNS_KEPT];
} esea_task_t;

/* The own clock. */
typedef struct {
    volatile bool runs; /* false while the main loop starts afresh, and in a replay */
    uint32_t tick;      /* of the next base tick */
    uint32_t told_tick; /* at which a HEARTBEAT was sent last */
    uint32_t last_count;
    bool timed;    /* last_count is of the tick before */
    uint64_t time; /* the device clock: base ticks since power-on, of the present one */
    bool counted;
    bool in_time;        /* all that ran since the watchdog was fed */
    uint32_t late_runs;  /* when it was fed */
    /* Counters; they stay at their maximum. */
    uint32_t lost_ticks;
    uint32_t missed_runs; /* of a task whose run before had not ended */
    uint32_t dropped;     /* runs that found no room to wait in until they are sent */
} esea_clock_t;

/* What keeps the motor on, and how long still; in base ticks. */
typedef struct {
    esea_link_wanted_t wanted;
    uint32_t rearm;
    bool rearm_asked;
    bool stop_held;
    bool mode_on;           /* the last command had a mode other than 0 */
    bool not_armed;         /* the limits did not release; the host is still to be told */
    uint32_t deadline_left; /* of the command */
    uint32_t link_left;     /* until the host counts as gone */
    uint32_t fade_left;
    float fade_from_Nm[ESEA_LINK_AXES + 1u];
    uint32_t still_left; /* of zeroing */
    float still_from_rad[ESEA_LINK_ENCODERS + 1u];
    volatile bool zeroing_ends; /* asks the main loop to take the angles, or to give up */
    bool stood_still;
    uint32_t refused; /* events from the link that were refused; stays at its maximum */
} esea_motion_t;

/* What a coupling bears, as it is counted; `kept` goes into the store whole, between two ticks. */
typedef struct {
    esea_store_life_t kept;
    bool known; /* the deflection and torque of the tick before */
    float theta_rad, tau_Nm;
    uint32_t ticks; /* less whole seconds */
    uint32_t still; /* ticks since it moved, up to those of a rest */
    uint32_t unsaved_s; /* counted since the last save */
} esea_life_t;

typedef struct esea_app {
    const esea_port_t *port;
    esea_link_control_t control;
    ESEA_STATE state;
    ESEA_FAULT fault;
    bool referenced;
    uint8_t zero; /* an ESEA_ZERO: where it comes from */
    volatile bool zero_doubted, use_changed; /* for keep.c, once the motor is off */
    uint32_t active_ticks; /* with the motor on, less whole seconds */
    ESEA_STATE told; /* the state that was last sent */
    ESEA_FAULT fault_told;
    esea_clock_t clock;
    esea_task_t tasks[ESEA_LINK_TASKS];
    esea_link_in_t in[ESEA_LINK_TASKS]; /* of each task: taken at the tick at which its run starts */
    esea_link_out_t out[ESEA_LINK_TASKS];
    esea_motion_t motion;
    esea_life_t life[ESEA_LINK_COUPLINGS > 0u ? ESEA_LINK_COUPLINGS : 1u];
    float measured[ESEA_LINK_MEASURED + 1u]; /* one more, for an array of none is no array */

    esea_stream_t streams[ESEA_LINK_STREAMS];
    esea_key_t key;
    esea_parameters_t parameters;
    esea_signing_t signing;

    esea_reader_t reader;
    uint32_t heard_ms; /* when a byte came last */
    mavlink_status_t sending;
    esea_guest_t *guest; /* whom answers go to; NULL: the host */
    esea_stamp_t stamp;
    uint32_t boot;       /* number of this start, never 0 */
    uint32_t refused_ms; /* when a text last said that something was refused */
    uint32_t next_tick[ESEA_LINK_TASKS]; /* replay: sequence number expected next, a task */
    bool started[ESEA_LINK_TASKS];       /* replay: whether the task has run since the reset */
    uint32_t released_tick;              /* replay: tick of the last release of the latches */
    bool released;                       /* replay: whether there was one since the reset */
    uint32_t empty_ticks;                /* ticks of measuring nothing */
    /* Counters; they stay at their maximum.  The first two start again at a reset. */
    uint32_t steps;
    uint32_t sequence_gaps;
    uint32_t bad_frames;
    uint32_t unknown_messages;
    uint32_t expired;
} esea_app_t;

/* Initial state, self-test, and a HEARTBEAT that says what was found. */
void esea_app_init(esea_app_t *app, const esea_port_t *port);

/* One base tick: call it at every one. */
void esea_app_tick(esea_app_t *app);

/* Tasks slower than the tick; the port's `pend` asks for it. */
void esea_app_background(esea_app_t *app);

/* Handles what has been received, sends what waits, then waits until there may be more.  Call it for
 * ever. */
void esea_app_poll(esea_app_t *app);

/* Somebody beside the host came in, and is told who commands; his bytes, or that none came.  A stop in them is taken,
 * all else is left.  `last`: no more will come.  What is answered stands in the guest. */
void esea_app_greet(esea_app_t *app, esea_guest_t *guest, const char *commander);
void esea_app_overhear(esea_app_t *app, esea_guest_t *guest, const uint8_t *bytes, size_t count, bool last);

/* Latches a fault and tells of it.  Takes no step; may be called from a fault handler. */
void esea_app_fail(esea_app_t *app, ESEA_FAULT fault);

/* -- between the files ------------------------------------------------------------------------- */

/* Follows an event and does what entering a state asks; false when it is refused.  From the tick, or
 * with interrupts held off. */
bool esea_app_event(esea_app_t *app, ESEA_EVENT event);

/* The same for the main loop, which also does what must wait until no step runs. */
bool esea_app_ask(esea_app_t *app, ESEA_EVENT event);

/* Starts all but the link and what must survive; false when the self-test finds something. */
bool esea_app_reset(esea_app_t *app);

/* No torque, and the motors off. */
void esea_app_motor_off(const esea_app_t *app);

/* Latches STACK_EXHAUSTED where it is. */
void esea_app_check_stack(esea_app_t *app);

/* Ends zeroing, from the main loop: coefficients change while no step reads them. */
void esea_app_end_zeroing(esea_app_t *app);

/* Freezes the black box where the board is in FAULT; `tick`: of what was found. */
void esea_app_freeze(esea_app_t *app, uint32_t tick);

/* Counts what a tick did to the couplings. */
void esea_life_tick(esea_app_t *app);

/* Timer ticks of a step, those of measuring it included. */
uint32_t esea_app_measure(esea_app_t *app, uint32_t task, const esea_link_in_t *in, esea_link_out_t *out);

void esea_send(esea_app_t *app, const mavlink_message_t *message);
/* Fields of a message, as the board's next frame. */
#define ESEA_SEND(app, name, fields) \
    do { \
        mavlink_message_t frame; \
        (void)mavlink_msg_##name##_encode_status( \
                ESEA_LINK_SYSTEM, ESEA_LINK_COMPONENT, &(app)->sending, &frame, &(fields)); \
        esea_send(app, &frame); \
    } while (0)
void esea_send_heartbeat(esea_app_t *app);
void esea_send_info(esea_app_t *app);
void esea_send_clock(esea_app_t *app);
void esea_send_traffic(esea_app_t *app);
/* `late`: denied for its age. */
void esea_send_ack(esea_app_t *app, const mavlink_message_t *to, uint16_t command, uint8_t result, bool late);
/* The board's time, and that of signatures. */
void esea_send_stamp(esea_app_t *app);
/* The device clock, which no reset sets back. */
uint32_t esea_now_ms(const esea_app_t *app);
/* A text of two parts; what is longer than 50 characters is cut. */
void esea_send_text(esea_app_t *app, uint8_t severity, const char *first, const char *second);
void esea_send_kept(esea_app_t *app, uint8_t result);
/* A coupling that is fitted, by its axis; behind those what the store has aside. */
void esea_send_life(esea_app_t *app, uint32_t number, uint8_t result);
/* Records of the black box from the first on that is asked for. */
void esea_send_blackbox(esea_app_t *app, uint32_t first);
/* The answer to TIMESYNC. */
void esea_send_time(esea_app_t *app, int64_t asked_ns);
/* At most one run of each task that waits; whether there was one. */
bool esea_send_runs(esea_app_t *app);

/* Whether a message to this address is meant for the board. */
static inline bool esea_meant(uint8_t system, uint8_t component)
{
    return (system == 0u || system == ESEA_LINK_SYSTEM) && (component == 0u || component == ESEA_LINK_COMPONENT);
}

static inline void esea_count(uint32_t *counter)
{
    if (*counter != UINT32_MAX)
        ++*counter;
}

/* Base ticks of a time; at least one. */
static inline uint32_t esea_ticks(uint32_t ms)
{
    const uint32_t ticks = ms * 1000u / ESEA_LINK_TICK_US;

    return ticks > 0u ? ticks : 1u;
}

#endif
