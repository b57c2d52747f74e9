/* License: MIT. */
#include "app.h"

#include <string.h>

static bool stop_open(const esea_app_t *app)
{
    return app->port->stop_open != NULL && app->port->stop_open();
}

static esea_guards_t guards_of(const esea_app_t *app, ESEA_EVENT event)
{
    /* A RELEASE takes back the stop that is held; an open line it cannot. */
    const bool held = app->motion.stop_held && event != ESEA_EVENT_RELEASE;
    const esea_guards_t guards = {
        .drive = ESEA_LINK_AXES > 0u,
        .encoders = ESEA_LINK_ENCODERS > 0u,
        .referenced = app->referenced,
        .stop_clear = !held && !stop_open(app),
        .link_live = app->motion.link_left > 0u,
        .mode_off = !app->motion.mode_on,
        .released = !app->motion.rearm_asked && esea_link_outcome(app->out).fault == 0u,
        .clearable = app->fault < ESEA_FIRST_BOARD_FAULT,
    };

    return guards;
}

/* What was wanted before does not come back, whatever way the motor went off. */
static void forget_wanted(esea_motion_t *motion)
{
    memset(&motion->wanted, 0, sizeof motion->wanted);
    motion->mode_on = false;
    motion->deadline_left = 0u;
    motion->fade_left = 0u;
}

static void enter(esea_app_t *app, ESEA_STATE from)
{
    esea_motion_t *const motion = &app->motion;

    if (app->state == from)
        return;
    if (app->port->store != NULL && app->state == ESEA_STATE_ARMED && from == ESEA_STATE_READY)
        esea_count(&app->port->store->set.use.armings);
    if (app->port->store != NULL && app->state == ESEA_STATE_FAULT)
        esea_count(&app->port->store->set.use.faults);
    app->use_changed = app->use_changed || esea_state_drives(from) || app->state == ESEA_STATE_FAULT;
    /* A sensor that is wrong may have slipped: what it was zeroed at is not to be put back. */
    if (app->state == ESEA_STATE_FAULT && esea_link_doubts_zero((uint32_t)app->fault))
        app->zero_doubted = true;
    if (!esea_state_drives(app->state) || app->state == ESEA_STATE_ARMED)
        forget_wanted(motion);
    if (app->state == ESEA_STATE_ARMED && from == ESEA_STATE_READY)
        motion->rearm_asked = true;
    if (app->state == ESEA_STATE_LETTING_GO || app->state == ESEA_STATE_STOPPING) {
        motion->fade_left = esea_ticks(app->state == ESEA_STATE_STOPPING ? ESEA_STOP_OFF_MS : ESEA_FADE_MS);
        esea_link_fade_from(app->out, motion->fade_from_Nm);
    }
    if (app->state == ESEA_STATE_ARMED && from == ESEA_STATE_READY && app->port->blackbox != NULL &&
        esea_blackbox_frozen(app->port->blackbox))
        esea_blackbox_release(app->port->blackbox);
    if (from == ESEA_STATE_ZEROING) /* whoever ended it: the coefficients are not those of use */
        motion->zeroing_ends = true;
    if (app->state == ESEA_STATE_ZEROING) {
        app->referenced = false;
        motion->still_left = esea_ticks(ESEA_ZEROING_MS);
    }
}

bool esea_app_event(esea_app_t *app, ESEA_EVENT event)
{
    const esea_guards_t guards = guards_of(app, event);
    const ESEA_STATE from = app->state;
    const bool taken = esea_machine_take(&app->state, event, &guards);

    if (event == ESEA_EVENT_STOP)
        app->motion.stop_held = true;
    else if (event == ESEA_EVENT_RELEASE && taken)
        app->motion.stop_held = false;
    else if (event == ESEA_EVENT_CLEAR && taken)
        app->fault = ESEA_FAULT_NONE;
    if (app->state == ESEA_STATE_FAULT && from != ESEA_STATE_FAULT && app->fault == ESEA_FAULT_NONE)
        app->fault = ESEA_FAULT_STATE_UNKNOWN;
    enter(app, from);
    return taken;
}

void esea_app_freeze(esea_app_t *app, uint32_t tick)
{
    if (app->state == ESEA_STATE_FAULT && app->port->blackbox != NULL)
        esea_blackbox_freeze(app->port->blackbox, (uint32_t)app->fault, tick);
}

void esea_app_fail(esea_app_t *app, ESEA_FAULT fault)
{
    /* The first fault is the one to report: later ones may follow from it. */
    if (app->fault == ESEA_FAULT_NONE)
        app->fault = fault;
    if (app->fault >= ESEA_FIRST_BOARD_FAULT)
        app->clock.runs = false;
    (void)esea_app_event(app, ESEA_EVENT_FAILED);
    esea_app_freeze(app, app->clock.tick);
    esea_app_motor_off(app);
    esea_send_heartbeat(app);
    app->told = app->state;
}

void esea_app_motor_off(const esea_app_t *app)
{
    static const float none_Nm[ESEA_LINK_AXES + 1u] = { 0.0f };

    if (app->port->motor != NULL)
        app->port->motor(none_Nm, false);
}

void esea_app_check_stack(esea_app_t *app)
{
    if (app->fault == ESEA_FAULT_NONE && app->port->stack_peak_bytes() >= app->port->stack_bytes)
        esea_app_fail(app, ESEA_FAULT_STACK_EXHAUSTED);
}

uint32_t esea_app_measure(esea_app_t *app, uint32_t task, const esea_link_in_t *in, esea_link_out_t *out)
{
    /* volatile: the compiler must call a step and the one that does nothing in the same way. */
    esea_link_step_fn *volatile step = esea_link_step(task);
    uint32_t start, stop;

    app->port->quiet(true);
    start = app->port->ticks();
    step(&app->control, in, out);
    stop = app->port->ticks();
    app->port->quiet(false);
    return stop - start;
}

/* The device's C from its initial state; false when a default is refused. */
static bool start_control(esea_app_t *app)
{
    uint32_t task;

    for (task = 0u; task < ESEA_LINK_TASKS; ++task)
        app->tasks[task].due = false;
    memset(app->out, 0, sizeof app->out);
    app->clock.tick = 0u;
    app->clock.told_tick = 0u;
    app->clock.counted = false;
    memset(app->started, 0, sizeof app->started);
    app->released = false;
    esea_key_ask(app);
    if (!esea_link_sealed(&app->control)) { /* memory was overwritten */
        (void)esea_link_init(&app->control);
        esea_send_text(app, MAV_SEVERITY_WARNING, "parameters were corrupt: defaults", "");
    }
    return esea_link_restart(&app->control) == 0u;
}

bool esea_app_ask(esea_app_t *app, ESEA_EVENT event)
{
    static const float no_offset[ESEA_LINK_ENCODERS + 1u];
    ESEA_STATE from;
    bool taken;

    app->port->quiet(true);
    from = app->state;
    taken = esea_app_event(app, event);
    app->port->quiet(false);
    if (!taken)
        esea_count(&app->motion.refused);
    if (app->state == from)
        return taken;

    /* The main loop is what runs only when no step does: here the control code may start afresh. */
    if (app->state == ESEA_STATE_REPLAY || from == ESEA_STATE_REPLAY || app->state == ESEA_STATE_ZEROING) {
        app->clock.runs = false;
        (void)start_control(app);
        if (app->state == ESEA_STATE_ZEROING)
            esea_link_measure_zero(&app->control);
        else if (app->state == ESEA_STATE_REPLAY)
            (void)esea_link_put_zeros(&app->control, no_offset); /* unzeroed encoders would answer invalid */
        else
            app->referenced = esea_kept_zeros(app);
        app->clock.runs = app->state != ESEA_STATE_REPLAY;
    }
    return taken;
}

/* Whether limits that have just been started hold each motor at zero, whatever is measured. */
static bool limits_hold(esea_app_t *app)
{
    const uint32_t axes = ESEA_LINK_AXES; /* in a variable: there may be none */
    esea_link_in_t in;
    esea_link_outcome_t outcome;
    uint32_t number;
    bool hold = true;

    memset(&in, 0, sizeof in);
    for (number = 0u; number < ESEA_LINK_TASKS; ++number)
        if (esea_link_every(number) == 1u)
            esea_link_step(number)(&app->control, &in, &app->out[number]);
    outcome = esea_link_outcome(app->out);
    for (number = 0u; number < axes; ++number)
        hold = hold && outcome.u_Nm[number] == 0.0f && outcome.faults[number] != 0u;
    return start_control(app) && hold;
}

bool esea_app_reset(esea_app_t *app)
{
    const ESEA_FAULT found = app->port->trouble != NULL ? (ESEA_FAULT)app->port->trouble() : ESEA_FAULT_NONE;
    esea_link_in_t in;
    esea_link_out_t out;

    app->clock.runs = false;
    if (app->port->store != NULL && found == ESEA_FAULT_WATCHDOG)
        esea_count(&app->port->store->set.use.watchdog_resets);
    if (app->port->blackbox != NULL)
        esea_blackbox_start(app->port->blackbox, (uint32_t)found);
    app->fault = ESEA_FAULT_NONE;
    app->steps = 0u;
    app->sequence_gaps = 0u;
    app->motion.zeroing_ends = false;
    app->referenced = false;
    forget_wanted(&app->motion);

    (void)esea_app_event(app, ESEA_EVENT_STARTED);
    if (!start_control(app)) {
        esea_app_fail(app, ESEA_FAULT_PREPARE_REFUSED);
        return false;
    }
    if (!limits_hold(app)) {
        esea_app_fail(app, ESEA_FAULT_SELF_TEST);
        return false;
    }
    if (found != ESEA_FAULT_NONE) {
        esea_app_fail(app, found);
        return false;
    }
    memset(&in, 0, sizeof in);
    app->empty_ticks = esea_app_measure(app, ESEA_LINK_TASKS, &in, &out);
    esea_app_check_stack(app);
    if (app->fault != ESEA_FAULT_NONE)
        return false;
    app->referenced = esea_kept_zeros(app);
    (void)esea_app_event(app, ESEA_EVENT_PASSED);
    app->clock.runs = true;
    return true;
}

void esea_app_end_zeroing(esea_app_t *app)
{
    app->clock.runs = false;
    if (app->state == ESEA_STATE_ZEROING) { /* else stopped meanwhile */
        static const float turn_rad = 6.2831853f;
        const uint32_t encoders = ESEA_LINK_ENCODERS; /* a variable, for a device may have none */
        float zeros_rad[ESEA_LINK_ENCODERS + 1u];
        uint32_t i;

        esea_link_angles(app->out, zeros_rad);
        /* They show the turn next to the joint's range, whose middle is not 0; a zero is within half a turn of 0. */
        for (i = 0u; i < encoders; ++i) {
            if (zeros_rad[i] > 0.5f * turn_rad)
                zeros_rad[i] -= turn_rad;
            else if (zeros_rad[i] < -0.5f * turn_rad)
                zeros_rad[i] += turn_rad;
        }
        app->referenced = app->motion.stood_still && esea_link_put_zeros(&app->control, zeros_rad);
        (void)esea_app_ask(app, app->referenced ? ESEA_EVENT_ZEROED : ESEA_EVENT_NOT_ZEROED);
    }
    if (app->referenced)
        esea_keep_zeros(app);
    else
        esea_forget_zeros(app); /* somebody found them wrong */
    if (!app->referenced)
        app->referenced = esea_link_unzero(&app->control);
    app->motion.zeroing_ends = false;
    esea_key_ask(app);
    app->clock.counted = false; /* the ticks meanwhile are none that were lost */
    app->clock.runs = app->fault < ESEA_FIRST_BOARD_FAULT;
}
