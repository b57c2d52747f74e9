/* The application: frames in, one step of a task for each, frames out.
 *
 *   BOOT ----> READY ----> RUNNING          the first input makes it RUNNING
 *     \          |            |
 *      \---------+-----> FAULT              latched; only the reset command leaves it, to READY
 *
 * The host clocks it ("processor in the loop"): a task runs when its input comes in.  There is no
 * control mathematics here; that is in the generated files.  The caller owns all memory, and any
 * number of instances may run side by side.
 *
 * License: MIT. */
#ifndef ESEA_APP_H
#define ESEA_APP_H

#include <stdint.h>

#include "port.h"
#include ESEA_LINK_HEADER /* the device's binding, esea_<device>_link.h: the build names it */

typedef struct {
    const esea_port_t *port;
    esea_link_control_t control;
    mavlink_message_t received; /* the frame that is coming in */
    mavlink_status_t receiving;
    mavlink_status_t sending;
    ESEA_MODE mode;
    ESEA_FAULT fault;
    uint32_t next_tick[ESEA_LINK_TASKS]; /* sequence number expected next, a task */
    bool started[ESEA_LINK_TASKS];       /* whether the task has run since the reset */
    uint32_t released_tick;              /* tick of the last release of the latches */
    bool released;                       /* whether there was one since the reset */
    uint32_t empty_ticks;                /* ticks of measuring nothing */
    /* Counters; they stay at their maximum.  The first two start again at a reset. */
    uint32_t steps;
    uint32_t sequence_gaps;
    uint32_t bad_frames;
    uint32_t unknown_messages;
} esea_app_t;

/* Initial state, and a HEARTBEAT that says so. */
void esea_app_init(esea_app_t *app, const esea_port_t *port);

/* Handles what has been received, then sleeps until there may be more.  Call it for ever. */
void esea_app_poll(esea_app_t *app);

/* Latches a fault and tells of it.  Takes no step; may be called from a fault handler. */
void esea_app_fail(esea_app_t *app, ESEA_FAULT fault);

#endif
