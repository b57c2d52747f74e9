/* Parameters: MAVLink's standard protocol over the device's tunables.
 *
 * License: MIT. */
#include "app.h"

#include <string.h>

static bool inside(const esea_link_parameter_t *parameter, float value)
{
    return value >= parameter->low && value <= parameter->high; /* NaN is not */
}

/* With the motor off, and while neither zeroing nor a replay has the coefficients. */
static bool may_change(const esea_app_t *app)
{
    return esea_state_computes(app->state) && !esea_state_drives(app->state) && app->state != ESEA_STATE_ZEROING &&
           !app->motion.zeroing_ends;
}

/* Coefficients beside those in use, then both at once: the main loop runs only when no step does, and
 * none begins meanwhile. */
static bool put_in_force(esea_app_t *app)
{
    if (!esea_link_make(&app->control))
        return false;
    app->port->quiet(true);
    esea_link_take(&app->control);
    esea_key_ask(app);
    app->port->quiet(false);
    return true;
}

/* A kept value as it can be taken.  A limit goes to the bound next to it, unless the default limits more; what is
 * no number, and any other parameter, has its default. */
static uint8_t judge(const esea_link_parameter_t *parameter, float *value)
{
    const float bound = *value < parameter->low ? parameter->low : parameter->high;

    if (inside(parameter, *value))
        return ESEA_KEPT_TAKEN;
    if (parameter->safer != 0 && *value - *value == 0.0f && /* finite */
            !((parameter->initial - bound) * (float)parameter->safer > 0.0f)) {
        *value = bound;
        return ESEA_KEPT_CLIPPED;
    }
    *value = parameter->initial;
    return ESEA_KEPT_OUTSIDE;
}

/* Number of a parameter by what it is kept under; that of all when it is none that can be set. */
static uint32_t kept_as(uint32_t key)
{
    uint32_t i;

    for (i = 0u; i < ESEA_LINK_PARAMETERS; ++i)
        if (esea_link_parameter(i)->key == key && !esea_link_parameter(i)->fixed)
            break;
    return i;
}

/* Values that are refused together: one by one over the defaults, the limits first, so that no other parameter can
 * widen one; a value that is refused beside those before it has its default. */
static void ask_one_by_one(esea_app_t *app, const float *values)
{
    uint32_t i, others;

    esea_link_ask_defaults(&app->control);
    for (others = 0u; others < 2u; ++others)
        for (i = 0u; i < ESEA_LINK_PARAMETERS; ++i) {
            const esea_link_parameter_t *const parameter = esea_link_parameter(i);

            if (parameter->fixed || (parameter->safer == 0) != (others == 1u))
                continue;
            esea_link_put(&app->control, i, values[i]);
            if (esea_link_make(&app->control))
                continue;
            esea_link_put(&app->control, i, parameter->initial);
            app->parameters.found[i] = ESEA_KEPT_CONFLICTING;
        }
}

/* Takes kept values into the change, each by itself; false when there are none. */
static bool ask_kept(esea_app_t *app)
{
    const esea_store_parameter_t *kept = NULL;
    const uint32_t count = esea_kept_parameters(app, &kept);
    float values[ESEA_LINK_PARAMETERS + 1u];
    uint32_t i, k;

    memset(app->parameters.found, ESEA_KEPT_TAKEN, sizeof app->parameters.found);
    for (i = 0u; i < ESEA_LINK_PARAMETERS; ++i)
        values[i] = esea_link_parameter(i)->initial;
    for (k = 0u; k < count; ++k) {
        i = kept_as(kept[k].id);
        if (i < ESEA_LINK_PARAMETERS) {
            values[i] = kept[k].value;
            app->parameters.found[i] = judge(esea_link_parameter(i), &values[i]);
        }
    }
    esea_link_ask_defaults(&app->control);
    for (i = 0u; i < ESEA_LINK_PARAMETERS; ++i)
        if (!esea_link_parameter(i)->fixed)
            esea_link_put(&app->control, i, values[i]);
    if (!esea_link_make(&app->control))
        ask_one_by_one(app, values);
    return count > 0u;
}

/* Kept values that are in force. */
static uint32_t in_force(const esea_app_t *app)
{
    const esea_store_parameter_t *kept = NULL;
    const uint32_t count = esea_kept_parameters(app, &kept);
    uint32_t k, i, good = 0u;

    for (k = 0u; k < count; ++k) {
        i = kept_as(kept[k].id);
        good += i < ESEA_LINK_PARAMETERS && app->parameters.found[i] == ESEA_KEPT_TAKEN ? 1u : 0u;
    }
    return good;
}

void esea_parameters_tell(esea_app_t *app)
{
    if (app->port->notice != NULL)
        esea_send_text(app, MAV_SEVERITY_WARNING, app->port->notice, "");
    app->parameters.told = 0u;
}

void esea_parameters_start(esea_app_t *app)
{
    const esea_store_parameter_t *kept = NULL;
    const esea_store_t *const store = app->port->store;

    app->parameters.listed = ESEA_LINK_PARAMETERS;
    app->parameters.told = UINT32_MAX;
    if (esea_link_init(&app->control) == 0u && ask_kept(app))
        (void)put_in_force(app);
    if (in_force(app) < esea_kept_parameters(app, &kept) ||
        (store != NULL && store->status != ESEA_STORE_LOADED && store->status != ESEA_STORE_EMPTY))
        app->parameters.told = 0u;
}

/* -- what is said of kept values ------------------------------------------------------------------- */

#define TEXT_BYTES MAVLINK_MSG_STATUSTEXT_FIELD_TEXT_LEN

static char *put_word(char *to, const char *word)
{
    while (*word != '\0')
        *to++ = *word++;
    return to;
}

static char *put_digits(char *to, uint32_t value, uint32_t base)
{
    char digits[10];
    uint32_t count = 0u;

    do {
        digits[count++] = "0123456789ABCDEF"[value % base];
        value /= base;
    } while (value > 0u);
    while (count > 0u)
        *to++ = digits[--count];
    return to;
}

/* Six digits of a number, as 1.5e-3. */
static char *put_number(char *to, float value)
{
    uint32_t digits, divisor = 100000u;
    int32_t power = 0;

    if (value - value != 0.0f)
        return put_word(to, value < 0.0f ? "-inf" : value > 0.0f ? "inf" : "nan");
    if (value < 0.0f)
        *to++ = '-';
    value = value < 0.0f ? -value : value;
    for (; value >= 10.0f; ++power)
        value /= 10.0f;
    for (; value < 1.0f && value > 0.0f; --power)
        value *= 10.0f;
    digits = (uint32_t)(value * 100000.0f + 0.5f); /* at most 1000000, which is 10.0000 */
    to = put_digits(to, digits / divisor, 10u);
    for (digits %= divisor; digits > 0u; digits %= divisor) {
        if (divisor == 100000u)
            *to++ = '.';
        divisor /= 10u;
        *to++ = (char)('0' + (char)(digits / divisor));
    }
    if (power != 0)
        *to++ = 'e';
    if (power < 0)
        *to++ = '-';
    return power != 0 ? put_digits(to, (uint32_t)(power < 0 ? -power : power), 10u) : to;
}

/* What is to be said of a kept value; false when it is in force. */
static bool tell_value(esea_app_t *app, const esea_store_parameter_t *kept)
{
    static const char *const said[] = { ": taken", ": clipped", ": out of bounds", ": conflicting" };
    const uint32_t index = kept_as(kept->id);
    char text[2u * TEXT_BYTES];
    char *end = text;

    if (index < ESEA_LINK_PARAMETERS && app->parameters.found[index] == ESEA_KEPT_TAKEN)
        return false;
    if (index < ESEA_LINK_PARAMETERS)
        end = put_word(end, esea_link_parameter(index)->id);
    else
        end = put_digits(put_word(end, "0x"), kept->id, 16u);
    *end++ = ' ';
    end = put_number(end, kept->value);
    end = put_word(end, index < ESEA_LINK_PARAMETERS ? said[app->parameters.found[index]] : ": unknown");
    *end = '\0';
    esea_send_text(app, MAV_SEVERITY_WARNING, "kept ", text);
    return true;
}

static void tell_sum(esea_app_t *app, uint32_t count)
{
    const esea_store_t *const store = app->port->store;
    char text[TEXT_BYTES];
    char *end = text;

    if (store != NULL && store->status == ESEA_STORE_OTHER_LAYOUT)
        end = put_word(end, "a set of another layout, not taken");
    else if (store != NULL && store->status == ESEA_STORE_OTHER_DEVICE)
        end = put_word(end, "another device's set, not taken");
    else {
        end = put_word(put_digits(end, in_force(app), 10u), " of ");
        end = put_word(put_digits(end, count, 10u), " values as they were saved");
    }
    *end = '\0';
    esea_send_text(app, MAV_SEVERITY_INFO, "kept: ", text);
}

/* One text; false when all is said. */
static bool tell_kept(esea_app_t *app)
{
    const esea_store_parameter_t *kept = NULL;
    const uint32_t count = esea_kept_parameters(app, &kept);

    while (app->parameters.told < count)
        if (tell_value(app, &kept[app->parameters.told++]))
            return true;
    if (app->parameters.told == UINT32_MAX)
        return false;
    app->parameters.told = UINT32_MAX;
    tell_sum(app, count);
    return true;
}

static void tell(esea_app_t *app, uint32_t index)
{
    const esea_link_parameter_t *const parameter = esea_link_parameter(index);
    mavlink_param_value_t fields;

    memset(&fields, 0, sizeof fields);
    memcpy(fields.param_id, parameter->id, sizeof fields.param_id);
    fields.param_value = esea_link_get(&app->control, index);
    fields.param_type = MAV_PARAM_TYPE_REAL32;
    fields.param_count = (uint16_t)ESEA_LINK_PARAMETERS;
    fields.param_index = (uint16_t)index;
    ESEA_SEND(app, param_value, fields);
}

void esea_parameters_error(esea_app_t *app, const mavlink_message_t *to, const char *id, int16_t index, uint8_t error)
{
    mavlink_param_error_t fields;

    memset(&fields, 0, sizeof fields);
    fields.target_system = to->sysid;
    fields.target_component = to->compid;
    memcpy(fields.param_id, id, sizeof fields.param_id);
    fields.param_index = index;
    fields.error = error;
    ESEA_SEND(app, param_error, fields);
}

/* Index of an id of 16 characters; the number of parameters when there is none. */
static uint32_t find(const char *id)
{
    uint32_t i;

    for (i = 0u; i < ESEA_LINK_PARAMETERS; ++i)
        if (strncmp(esea_link_parameter(i)->id, id, MAVLINK_MSG_PARAM_SET_FIELD_PARAM_ID_LEN) == 0)
            break;
    return i;
}

void esea_parameters_read(esea_app_t *app, const mavlink_message_t *message)
{
    mavlink_param_request_read_t asked;
    uint32_t index;

    mavlink_msg_param_request_read_decode(message, &asked);
    if (!esea_meant(asked.target_system, asked.target_component))
        return;
    index = asked.param_index >= 0 ? (uint32_t)asked.param_index : find(asked.param_id);
    if (esea_link_parameter(index) == NULL)
        esea_parameters_error(app, message, asked.param_id, asked.param_index, MAV_PARAM_ERROR_DOES_NOT_EXIST);
    else
        tell(app, index);
}

void esea_parameters_list(esea_app_t *app)
{
    app->parameters.listed = 0u;
}

bool esea_parameters_send(esea_app_t *app)
{
    if (app->parameters.listed >= ESEA_LINK_PARAMETERS)
        return tell_kept(app);
    tell(app, app->parameters.listed++);
    return true;
}

static uint8_t try_to_set(esea_app_t *app, uint32_t index, const mavlink_param_set_t *asked)
{
    const esea_link_parameter_t *const parameter = esea_link_parameter(index);

    if (parameter == NULL)
        return MAV_PARAM_ERROR_DOES_NOT_EXIST;
    if (parameter->fixed)
        return MAV_PARAM_ERROR_READ_ONLY;
    if (asked->param_type != MAV_PARAM_TYPE_REAL32 || !inside(parameter, asked->param_value))
        return MAV_PARAM_ERROR_VALUE_OUT_OF_RANGE;
    if (!may_change(app))
        return MAV_PARAM_ERROR_PERMISSION_DENIED;
    esea_link_ask(&app->control);
    esea_link_put(&app->control, index, asked->param_value);
    return put_in_force(app) ? MAV_PARAM_ERROR_NO_ERROR : MAV_PARAM_ERROR_VALUE_OUT_OF_RANGE;
}

void esea_parameters_set(esea_app_t *app, const mavlink_message_t *message)
{
    mavlink_param_set_t asked;
    uint32_t index;
    uint8_t error;

    mavlink_msg_param_set_decode(message, &asked);
    if (!esea_meant(asked.target_system, asked.target_component))
        return;
    index = find(asked.param_id);
    error = try_to_set(app, index, &asked);
    if (error != MAV_PARAM_ERROR_NO_ERROR) {
        esea_count(&app->parameters.refused);
        esea_parameters_error(app, message, asked.param_id, -1, error);
        if (error == MAV_PARAM_ERROR_PERMISSION_DENIED)
            esea_send_text(app, MAV_SEVERITY_WARNING, "parameter refused in state ",
                    esea_link_state_name((uint32_t)app->state));
    }
    if (esea_link_parameter(index) != NULL)
        tell(app, index); /* what is in force, whether it was set or not */
}

static uint8_t save(esea_app_t *app)
{
    if (esea_keep_parameters(app)) {
        memset(app->parameters.found, ESEA_KEPT_TAKEN, sizeof app->parameters.found);
        return MAV_RESULT_ACCEPTED;
    }
    esea_send_text(app, MAV_SEVERITY_WARNING, "not saved: ",
            app->port->store == NULL ? "this board keeps no parameters" : "the memory failed");
    return MAV_RESULT_FAILED;
}

uint8_t esea_parameters_storage(esea_app_t *app, float action)
{
    const esea_store_parameter_t *kept = NULL;

    if (!(action == 0.0f || action == 1.0f || action == 2.0f))
        return MAV_RESULT_DENIED;
    if (!may_change(app))
        return MAV_RESULT_TEMPORARILY_REJECTED;
    if (action == 1.0f)
        return save(app);
    if (action == 2.0f)
        esea_link_ask_defaults(&app->control);
    else if (!ask_kept(app))
        return MAV_RESULT_FAILED;
    else if (in_force(app) < esea_kept_parameters(app, &kept))
        app->parameters.told = 0u;
    return (uint8_t)(put_in_force(app) ? MAV_RESULT_ACCEPTED : MAV_RESULT_FAILED);
}
