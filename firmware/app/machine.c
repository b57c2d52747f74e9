/* Each state has a function that says where an event leads.  Every switch names all events: the
 * compiler finds one that was forgotten (-Wswitch-enum).
 *
 * Three rules hold in all of them: STOP is never refused; who asks for less torque (DISARM, OFF) is
 * never refused; from a state in which the motor may be on, a RESET is.
 *
 * License: MIT. */
#include "machine.h"

/* Each is given where the event came, and puts where it leads; false when it is refused. */
static bool to(ESEA_STATE *state, ESEA_STATE next)
{
    *state = next;
    return true;
}

/* Out of a stop, a fault that was seen to, or the self-test: never to a state with torque. */
static ESEA_STATE at_rest(const esea_guards_t *guards)
{
    if (!guards->stop_clear)
        return ESEA_STATE_STOPPED;
    return guards->referenced ? ESEA_STATE_READY : ESEA_STATE_UNREFERENCED;
}

/* Where a stop leads that finds the motor holding torque: a first one, of sound limits and not by the
 * stop line, releases it under control. */
static ESEA_STATE stopped(const esea_guards_t *guards)
{
    return guards->released && guards->stop_clear ? ESEA_STATE_STOPPING : ESEA_STATE_STOPPED;
}

static bool starting(ESEA_STATE *state, ESEA_EVENT event, const esea_guards_t *guards)
{
    const bool booting = *state == ESEA_STATE_BOOT;

    switch (event) {
    case ESEA_EVENT_STARTED:
        return booting && to(state, ESEA_STATE_SELF_TEST);
    case ESEA_EVENT_PASSED:
        return !booting && to(state, at_rest(guards));
    case ESEA_EVENT_FAILED:
        return to(state, ESEA_STATE_FAULT);
    case ESEA_EVENT_STOP: /* the stop is held, which leads to STOPPED */
    case ESEA_EVENT_DISARM:
    case ESEA_EVENT_OFF:
        return true;
    case ESEA_EVENT_RELEASE:
    case ESEA_EVENT_CLEAR:
    case ESEA_EVENT_RESET:
    case ESEA_EVENT_ZERO:
    case ESEA_EVENT_ARM:
    case ESEA_EVENT_ON:
    case ESEA_EVENT_INPUT:
    case ESEA_EVENT_ZEROED:
    case ESEA_EVENT_NOT_ZEROED:
    case ESEA_EVENT_REFUSED:
    case ESEA_EVENT_EXPIRED:
    case ESEA_EVENT_LINK_LOST:
    case ESEA_EVENT_FADED:
        return false;
    }
    return false;
}

/* UNREFERENCED and READY, which alone may be armed. */
static bool waiting(ESEA_STATE *state, ESEA_EVENT event, const esea_guards_t *guards)
{
    switch (event) {
    case ESEA_EVENT_STOP:
        return to(state, ESEA_STATE_STOPPED);
    case ESEA_EVENT_RESET:
        return to(state, ESEA_STATE_BOOT);
    case ESEA_EVENT_ZERO:
        return guards->encoders && to(state, ESEA_STATE_ZEROING);
    case ESEA_EVENT_ARM:
        return *state == ESEA_STATE_READY && guards->drive && guards->referenced && guards->stop_clear &&
               guards->link_live && guards->mode_off && to(state, ESEA_STATE_ARMED);
    case ESEA_EVENT_INPUT:
        return to(state, ESEA_STATE_REPLAY);
    case ESEA_EVENT_FAILED:
        return to(state, ESEA_STATE_FAULT);
    case ESEA_EVENT_DISARM:
    case ESEA_EVENT_OFF:
        return true;
    case ESEA_EVENT_RELEASE:
    case ESEA_EVENT_CLEAR:
    case ESEA_EVENT_ON:
    case ESEA_EVENT_STARTED:
    case ESEA_EVENT_PASSED:
    case ESEA_EVENT_ZEROED:
    case ESEA_EVENT_NOT_ZEROED:
    case ESEA_EVENT_REFUSED:
    case ESEA_EVENT_EXPIRED:
    case ESEA_EVENT_LINK_LOST:
    case ESEA_EVENT_FADED:
        return false;
    }
    return false;
}

static bool zeroing(ESEA_STATE *state, ESEA_EVENT event)
{
    switch (event) {
    case ESEA_EVENT_STOP:
        return to(state, ESEA_STATE_STOPPED);
    case ESEA_EVENT_ZEROED:
        return to(state, ESEA_STATE_READY);
    case ESEA_EVENT_NOT_ZEROED:
        return to(state, ESEA_STATE_UNREFERENCED);
    case ESEA_EVENT_FAILED:
        return to(state, ESEA_STATE_FAULT);
    case ESEA_EVENT_DISARM:
    case ESEA_EVENT_OFF:
        return true;
    case ESEA_EVENT_RELEASE:
    case ESEA_EVENT_CLEAR:
    case ESEA_EVENT_RESET:
    case ESEA_EVENT_ZERO:
    case ESEA_EVENT_ARM:
    case ESEA_EVENT_ON:
    case ESEA_EVENT_INPUT:
    case ESEA_EVENT_STARTED:
    case ESEA_EVENT_PASSED:
    case ESEA_EVENT_REFUSED:
    case ESEA_EVENT_EXPIRED:
    case ESEA_EVENT_LINK_LOST:
    case ESEA_EVENT_FADED:
        return false;
    }
    return false;
}

/* ARMED and ACTIVE: the motor is on. */
static bool armed(ESEA_STATE *state, ESEA_EVENT event, const esea_guards_t *guards)
{
    const bool active = *state == ESEA_STATE_ACTIVE;
    const ESEA_STATE away = active ? ESEA_STATE_LETTING_GO : ESEA_STATE_READY;

    switch (event) {
    case ESEA_EVENT_STOP:
        return to(state, active ? stopped(guards) : ESEA_STATE_STOPPED);
    case ESEA_EVENT_FAILED:
        return to(state, ESEA_STATE_FAULT);
    case ESEA_EVENT_ON:
        return guards->link_live && guards->stop_clear && (active || guards->released) &&
               to(state, ESEA_STATE_ACTIVE);
    case ESEA_EVENT_OFF:
        return to(state, ESEA_STATE_ARMED);
    case ESEA_EVENT_DISARM:
    case ESEA_EVENT_LINK_LOST:
        return to(state, away);
    case ESEA_EVENT_EXPIRED:
        return active && to(state, ESEA_STATE_LETTING_GO);
    case ESEA_EVENT_REFUSED:
        return !active && to(state, ESEA_STATE_READY);
    case ESEA_EVENT_RELEASE:
    case ESEA_EVENT_CLEAR:
    case ESEA_EVENT_RESET:
    case ESEA_EVENT_ZERO:
    case ESEA_EVENT_ARM:
    case ESEA_EVENT_INPUT:
    case ESEA_EVENT_STARTED:
    case ESEA_EVENT_PASSED:
    case ESEA_EVENT_ZEROED:
    case ESEA_EVENT_NOT_ZEROED:
    case ESEA_EVENT_FADED:
        return false;
    }
    return false;
}

/* LETTING_GO and STOPPING: no command brings the torque back from here. */
static bool letting_go(ESEA_STATE *state, ESEA_EVENT event, const esea_guards_t *guards)
{
    const bool stopping = *state == ESEA_STATE_STOPPING;

    switch (event) {
    case ESEA_EVENT_STOP:
        return to(state, stopping ? ESEA_STATE_STOPPED : stopped(guards));
    case ESEA_EVENT_FADED:
        return to(state, stopping ? ESEA_STATE_STOPPED : ESEA_STATE_READY);
    case ESEA_EVENT_FAILED:
        return to(state, ESEA_STATE_FAULT);
    case ESEA_EVENT_DISARM:
    case ESEA_EVENT_OFF:
        return true;
    case ESEA_EVENT_RELEASE:
    case ESEA_EVENT_CLEAR:
    case ESEA_EVENT_RESET:
    case ESEA_EVENT_ZERO:
    case ESEA_EVENT_ARM:
    case ESEA_EVENT_ON:
    case ESEA_EVENT_INPUT:
    case ESEA_EVENT_STARTED:
    case ESEA_EVENT_PASSED:
    case ESEA_EVENT_ZEROED:
    case ESEA_EVENT_NOT_ZEROED:
    case ESEA_EVENT_REFUSED:
    case ESEA_EVENT_EXPIRED:
    case ESEA_EVENT_LINK_LOST:
        return false;
    }
    return false;
}

/* STOPPED and FAULT: only a person leads out, and only to rest. */
static bool held(ESEA_STATE *state, ESEA_EVENT event, const esea_guards_t *guards)
{
    const bool stopped = *state == ESEA_STATE_STOPPED;

    switch (event) {
    case ESEA_EVENT_RELEASE:
        return stopped && guards->stop_clear && to(state, at_rest(guards));
    case ESEA_EVENT_CLEAR:
        return !stopped && guards->clearable && to(state, at_rest(guards));
    case ESEA_EVENT_RESET:
        return to(state, ESEA_STATE_BOOT);
    case ESEA_EVENT_FAILED:
        return to(state, ESEA_STATE_FAULT);
    case ESEA_EVENT_STOP:
    case ESEA_EVENT_DISARM:
    case ESEA_EVENT_OFF:
        return true;
    case ESEA_EVENT_ZERO:
    case ESEA_EVENT_ARM:
    case ESEA_EVENT_ON:
    case ESEA_EVENT_INPUT:
    case ESEA_EVENT_STARTED:
    case ESEA_EVENT_PASSED:
    case ESEA_EVENT_ZEROED:
    case ESEA_EVENT_NOT_ZEROED:
    case ESEA_EVENT_REFUSED:
    case ESEA_EVENT_EXPIRED:
    case ESEA_EVENT_LINK_LOST:
    case ESEA_EVENT_FADED:
        return false;
    }
    return false;
}

static bool replay(ESEA_STATE *state, ESEA_EVENT event)
{
    switch (event) {
    case ESEA_EVENT_STOP:
        return to(state, ESEA_STATE_STOPPED);
    case ESEA_EVENT_RESET:
        return to(state, ESEA_STATE_BOOT);
    case ESEA_EVENT_FAILED:
        return to(state, ESEA_STATE_FAULT);
    case ESEA_EVENT_INPUT:
    case ESEA_EVENT_DISARM:
    case ESEA_EVENT_OFF:
        return true;
    case ESEA_EVENT_RELEASE:
    case ESEA_EVENT_CLEAR:
    case ESEA_EVENT_ZERO:
    case ESEA_EVENT_ARM:
    case ESEA_EVENT_ON:
    case ESEA_EVENT_STARTED:
    case ESEA_EVENT_PASSED:
    case ESEA_EVENT_ZEROED:
    case ESEA_EVENT_NOT_ZEROED:
    case ESEA_EVENT_REFUSED:
    case ESEA_EVENT_EXPIRED:
    case ESEA_EVENT_LINK_LOST:
    case ESEA_EVENT_FADED:
        return false;
    }
    return false;
}

bool esea_machine_take(ESEA_STATE *state, ESEA_EVENT event, const esea_guards_t *guards)
{
    switch (*state) {
    case ESEA_STATE_BOOT:
    case ESEA_STATE_SELF_TEST:
        return starting(state, event, guards);
    case ESEA_STATE_UNREFERENCED:
    case ESEA_STATE_READY:
        return waiting(state, event, guards);
    case ESEA_STATE_ZEROING:
        return zeroing(state, event);
    case ESEA_STATE_ARMED:
    case ESEA_STATE_ACTIVE:
        return armed(state, event, guards);
    case ESEA_STATE_LETTING_GO:
    case ESEA_STATE_STOPPING:
        return letting_go(state, event, guards);
    case ESEA_STATE_STOPPED:
    case ESEA_STATE_FAULT:
        return held(state, event, guards);
    case ESEA_STATE_REPLAY:
        return replay(state, event);
    }
    *state = ESEA_STATE_FAULT; /* memory was overwritten */
    return event == ESEA_EVENT_STOP;
}
