/* The own clock.  The tick's interrupt samples, releases the latches, runs the tasks of every tick and
 * drives the motor; tasks that are slower run below it, and are preempted by it.  What crosses between
 * them is released at declared ticks, so that the bits do not depend on who preempts whom where.
 *
 * License: MIT. */
#include <math.h>
#include <string.h>

#include "app.h"

/* Counts a time down; true in the tick in which it ends. */
static bool ends(uint32_t *left)
{
    return *left > 0u && --*left == 0u;
}

/* Base ticks since the interrupt before, at least one; the device clock goes on by them. */
static uint32_t pass_time(esea_app_t *app)
{
    esea_clock_t *const clock = &app->clock;
    const uint32_t base = app->port->base_ticks;
    const uint32_t now = app->port->ticks();
    uint32_t passed = 1u;

    if (clock->timed && base > 0u)
        passed = (now - clock->last_count + base / 2u) / base;
    if (passed == 0u)
        passed = 1u;
    clock->timed = true;
    clock->last_count = now;
    clock->time += passed;
    return passed;
}

/* A base tick that found the one before still running has come late or not at all: its number is left
 * out, and the limits latch on it. */
static uint32_t next_tick(esea_app_t *app, uint32_t passed)
{
    esea_clock_t *const clock = &app->clock;

    if (clock->counted) {
        for (uint32_t lost = 1u; lost < passed; ++lost) {
            esea_count(&clock->lost_ticks);
            clock->in_time = false;
            ++clock->tick;
        }
    }
    clock->counted = true;
    return clock->tick++;
}

/* What the drivers found; told of by the main loop. */
static void watch_drivers(esea_app_t *app)
{
    const uint32_t fault = app->port->trouble != NULL ? app->port->trouble() : 0u;

    if (fault == 0u)
        return;
    if (app->fault == ESEA_FAULT_NONE || app->fault < ESEA_FIRST_BOARD_FAULT)
        app->fault = (ESEA_FAULT)fault; /* not to be cleared as one of the limits' */
    (void)esea_app_event(app, ESEA_EVENT_FAILED);
}

/* Counts only, so that it ends in time whatever the drive does. */
static void fade(esea_app_t *app)
{
    esea_motion_t *const motion = &app->motion;
    const bool stops = app->state == ESEA_STATE_STOPPING;
    const uint32_t rest = stops ? esea_ticks(ESEA_STOP_OFF_MS) - esea_ticks(ESEA_STOP_FADE_MS) : 0u;
    const uint32_t left = motion->fade_left > rest ? motion->fade_left - rest : 0u;
    const float share = (float)left / (float)esea_ticks(stops ? ESEA_STOP_FADE_MS : ESEA_FADE_MS);

    esea_link_fade(&motion->wanted, app->out, motion->fade_from_Nm, share);
    if (stops)
        esea_link_oppose(&motion->wanted, app->out, 1.0f - share);
    if (ends(&motion->fade_left))
        (void)esea_app_event(app, ESEA_EVENT_FADED);
}

/* Deadlines of the link and of what is wanted. */
static void supervise(esea_app_t *app)
{
    esea_motion_t *const motion = &app->motion;

    if (!esea_state_known(app->state)) /* memory was overwritten: the event finds it out */
        (void)esea_app_event(app, ESEA_EVENT_FAILED);
    watch_drivers(app);
    if (app->port->stop_open != NULL && app->port->stop_open())
        (void)esea_app_event(app, ESEA_EVENT_STOP);
    if (ends(&motion->link_left))
        (void)esea_app_event(app, ESEA_EVENT_LINK_LOST);
    if (ends(&motion->deadline_left))
        (void)esea_app_event(app, ESEA_EVENT_EXPIRED);
    if (app->state == ESEA_STATE_LETTING_GO || app->state == ESEA_STATE_STOPPING)
        fade(app);
}

/* What the limits are told: to hold, unless the motor may be on; and a new number to release. */
static void tell_limits(esea_app_t *app)
{
    esea_motion_t *const motion = &app->motion;
    const bool on = esea_state_drives(app->state) && app->state != ESEA_STATE_ARMED;
    /* Without a motor nothing is armed; limits may stand before a torque that others follow. */
    const bool may = ESEA_LINK_AXES > 0u ? esea_state_drives(app->state) : app->state == ESEA_STATE_READY;

    if (motion->rearm_asked)
        motion->rearm = motion->rearm < 7u ? motion->rearm + 1u : 0u;
    esea_link_hold(&motion->wanted, on, !may, motion->rearm);
}

/* What the limits say of this tick. */
static void watch_limits(esea_app_t *app, const esea_link_outcome_t *outcome)
{
    const bool asked = app->motion.rearm_asked;

    app->motion.rearm_asked = false;
    if (!esea_state_drives(app->state) || outcome->fault == 0u)
        return;
    if (asked) {
        app->motion.not_armed = esea_app_event(app, ESEA_EVENT_REFUSED);
        return;
    }
    app->fault = (ESEA_FAULT)outcome->fault;
    (void)esea_app_event(app, ESEA_EVENT_FAILED);
}

static void watch_zeroing(esea_app_t *app)
{
    esea_motion_t *const motion = &app->motion;
    const uint32_t whole = esea_ticks(ESEA_ZEROING_MS);

    if (app->state != ESEA_STATE_ZEROING || motion->zeroing_ends || motion->still_left == 0u)
        return;
    if (motion->still_left > whole / 2u) { /* the encoders settle in the first half */
        esea_link_angles(app->out, motion->still_from_rad);
        motion->stood_still = true;
    }
    motion->stood_still = motion->stood_still && esea_link_still(motion->still_from_rad, app->out);
    motion->zeroing_ends = ends(&motion->still_left);
}

/* Keeps a run until the main loop sends it. */
static void keep(esea_app_t *app, uint32_t number, uint32_t tick, uint32_t step_ticks)
{
    esea_task_t *const task = &app->tasks[number];
    esea_run_t *run;
    bool send[ESEA_SIDES];
    uint32_t side;

    for (side = 0u; side < ESEA_SIDES; ++side)
        send[side] = task->interval[side] > 0u && (tick - esea_link_phase(number)) % task->interval[side] == 0u;
    if (!send[0] && !send[1])
        return;
    if (task->head - task->tail >= ESEA_RUNS_KEPT) {
        esea_count(&app->clock.dropped);
        return;
    }
    run = &task->runs[task->head % ESEA_RUNS_KEPT];
    run->tick = tick;
    run->step_ticks = step_ticks;
    memcpy(run->send, send, sizeof send);
    run->in = app->in[number];
    run->out = app->out[number];
    task->head = task->head + 1u;
}

static void run(esea_app_t *app, uint32_t number, uint32_t tick, uint64_t time)
{
    const uint32_t start = app->port->ticks();
    uint32_t step_ticks;

    esea_link_step(number)(&app->control, &app->in[number], &app->out[number]);
    step_ticks = app->port->ticks() - start;
    keep(app, number, tick, step_ticks);
    esea_streams_take(app, number, tick, time, step_ticks);
}

static bool starts(uint32_t number, uint32_t tick)
{
    const uint32_t phase = esea_link_phase(number);

    return tick >= phase && (tick - phase) % esea_link_every(number) == 0u;
}

static void start_slower(esea_app_t *app, uint32_t tick)
{
    uint32_t number;

    for (number = 0u; number < ESEA_LINK_TASKS; ++number) {
        esea_task_t *const task = &app->tasks[number];

        if (esea_link_every(number) == 1u || !starts(number, tick))
            continue;
        if (task->due) { /* its run before has not ended: this one does not start, and the watch tells */
            esea_count(&app->clock.missed_runs);
            app->clock.in_time = false;
            continue;
        }
        esea_link_fill(number, app->measured, &app->motion.wanted, &app->in[number]);
        task->due_tick = tick;
        task->due_time = app->clock.time;
        task->due = true;
        app->port->pend();
    }
}

/* The slowest task: its period is the control cycle. */
static uint32_t slowest(void)
{
    uint32_t found = 0u, number;

    for (number = 1u; number < ESEA_LINK_TASKS; ++number)
        if (esea_link_every(number) > esea_link_every(found))
            found = number;
    return found;
}

/* The watchdog is fed where a control cycle begins and all of the one before has come and ended in time.
 * Where the clock rests, the motor is off, and the ticks alone keep it from resetting. */
static void feed(esea_app_t *app, uint32_t tick)
{
    const uint32_t late_runs = esea_link_late_runs(&app->control);
    const bool in_time = app->clock.in_time && late_runs == app->clock.late_runs;

    if (app->port->feed == NULL || !starts(slowest(), tick))
        return;
    if (in_time)
        app->port->feed();
    app->clock.in_time = true;
    app->clock.late_runs = late_runs;
}

/* The tick, for the black box. */
static void remember(esea_app_t *app, const esea_link_outcome_t *outcome, uint32_t tick)
{
    const bool on = esea_state_drives(app->state) && outcome->fault == 0u;
    const bool stop = app->motion.stop_held || (app->port->stop_open != NULL && app->port->stop_open());
    const uint32_t axes = ESEA_LINK_AXES; /* in a variable: there may be none */
    esea_blackbox_record_t record;
    uint32_t axis;

    if (app->port->blackbox == NULL)
        return;
    memset(&record, 0, sizeof record);
    record.tick = (uint16_t)tick;
    record.state = (uint8_t)app->state;
    record.fault = (uint8_t)app->fault;
    for (axis = 0u; axis < axes; ++axis) {
        record.faults[axis] = (uint8_t)outcome->faults[axis];
        record.u_Nm[axis] = on ? outcome->u_Nm[axis] : 0.0f;
    }
    record.flags = (uint8_t)((on ? ESEA_BLACKBOX_ON : 0u) | (stop ? ESEA_BLACKBOX_STOP : 0u));
    esea_blackbox_want(&record, &app->motion.wanted);
    memcpy(record.measured, app->measured, sizeof record.measured);
    esea_blackbox_add(app->port->blackbox, &record);
}

/* One fault releases all motors, in the same tick. */
static void drive(esea_app_t *app, const esea_link_outcome_t *outcome)
{
    const bool enable = esea_state_drives(app->state) && outcome->fault == 0u;

    if (!enable)
        esea_app_motor_off(app);
    else if (app->port->motor != NULL)
        app->port->motor(outcome->u_Nm, true);
    if (enable && ++app->active_ticks >= esea_ticks(1000u)) {
        app->active_ticks = 0u;
        if (app->port->store != NULL)
            esea_count(&app->port->store->set.use.active_s);
    }
}

void esea_app_tick(esea_app_t *app)
{
    esea_link_outcome_t outcome;
    uint32_t tick, number;
    const uint32_t passed = pass_time(app);

    if (!app->clock.runs) {
        /* The state may have passed from the motor on to a clock that rests between two ticks. */
        esea_app_motor_off(app);
        if (app->port->feed != NULL && !esea_state_drives(app->state))
            app->port->feed();
        return;
    }
    tick = next_tick(app, passed);
    for (number = 0u; number < ESEA_LINK_MEASURED; ++number)
        app->measured[number] = NAN;
    if (app->port->sample != NULL)
        app->port->sample(app->measured);
    supervise(app);
    tell_limits(app);

    esea_key_take(app, tick);
    esea_link_release_at(&app->control, tick);
    for (number = 0u; number < ESEA_LINK_TASKS; ++number)
        if (esea_link_every(number) == 1u && starts(number, tick)) {
            esea_link_fill(number, app->measured, &app->motion.wanted, &app->in[number]);
            run(app, number, tick, app->clock.time);
        }
    outcome = esea_link_outcome(app->out);
    watch_limits(app, &outcome);
    watch_zeroing(app);
    if (app->referenced && app->state != ESEA_STATE_ZEROING && esea_link_slipped(app->out))
        app->zero_doubted = true;
    drive(app, &outcome);
    esea_life_tick(app);
    start_slower(app, tick);
    feed(app, tick);
    remember(app, &outcome, tick);
    esea_app_freeze(app, tick);
}

void esea_app_background(esea_app_t *app)
{
    uint32_t number;

    for (number = 0u; number < ESEA_LINK_TASKS; ++number) {
        esea_task_t *const task = &app->tasks[number];

        if (!task->due)
            continue;
        run(app, number, task->due_tick, task->due_time);
        task->due = false;
    }
}
