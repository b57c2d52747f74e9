/* Parameters: MAVLink's standard protocol over the device's tunables.
 *
 * License: MIT. */
#include "app.h"

#include <string.h>

__attribute__((weak)) bool esea_keep_parameters(esea_app_t *app, const float *values, uint32_t count, uint32_t layout)
{
    (void)app;
    (void)values;
    (void)count;
    (void)layout;
    return false;
}

__attribute__((weak)) bool esea_kept_parameters(esea_app_t *app, float *values, uint32_t count, uint32_t layout)
{
    (void)app;
    (void)values;
    (void)count;
    (void)layout;
    return false;
}

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

/* Takes kept values into the change; false when there are none, or one is no value of its parameter. */
static bool ask_kept(esea_app_t *app)
{
    float values[ESEA_LINK_PARAMETERS + 1u];
    uint32_t i;

    for (i = 0u; i < ESEA_LINK_PARAMETERS; ++i)
        values[i] = esea_link_parameter(i)->initial;
    if (!esea_kept_parameters(app, values, ESEA_LINK_PARAMETERS, ESEA_LINK_PARAMETERS_LAYOUT))
        return false;
    esea_link_ask(&app->control);
    for (i = 0u; i < ESEA_LINK_PARAMETERS; ++i) {
        const esea_link_parameter_t *const parameter = esea_link_parameter(i);

        if (parameter->fixed)
            continue;
        if (!inside(parameter, values[i]))
            return false;
        esea_link_put(&app->control, i, values[i]);
    }
    return true;
}

void esea_parameters_start(esea_app_t *app)
{
    app->parameters.listed = ESEA_LINK_PARAMETERS;
    if (esea_link_init(&app->control) == 0u && ask_kept(app))
        (void)put_in_force(app);
}

static void tell(esea_app_t *app, uint32_t index)
{
    const esea_link_parameter_t *const parameter = esea_link_parameter(index);
    mavlink_param_value_t fields;
    mavlink_message_t message;

    memset(&fields, 0, sizeof fields);
    memcpy(fields.param_id, parameter->id, sizeof fields.param_id);
    fields.param_value = esea_link_get(&app->control, index);
    fields.param_type = MAV_PARAM_TYPE_REAL32;
    fields.param_count = (uint16_t)ESEA_LINK_PARAMETERS;
    fields.param_index = (uint16_t)index;
    (void)mavlink_msg_param_value_encode_status(ESEA_LINK_SYSTEM, ESEA_LINK_COMPONENT, &app->sending, &message, &fields);
    esea_send(app, &message);
}

void esea_parameters_error(esea_app_t *app, const mavlink_message_t *to, const char *id, int16_t index, uint8_t error)
{
    mavlink_param_error_t fields;
    mavlink_message_t message;

    memset(&fields, 0, sizeof fields);
    fields.target_system = to->sysid;
    fields.target_component = to->compid;
    memcpy(fields.param_id, id, sizeof fields.param_id);
    fields.param_index = index;
    fields.error = error;
    (void)mavlink_msg_param_error_encode_status(ESEA_LINK_SYSTEM, ESEA_LINK_COMPONENT, &app->sending, &message, &fields);
    esea_send(app, &message);
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
        return false;
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
    float values[ESEA_LINK_PARAMETERS + 1u];
    uint32_t i;

    for (i = 0u; i < ESEA_LINK_PARAMETERS; ++i)
        values[i] = esea_link_get(&app->control, i);
    if (esea_keep_parameters(app, values, ESEA_LINK_PARAMETERS, ESEA_LINK_PARAMETERS_LAYOUT))
        return MAV_RESULT_ACCEPTED;
    esea_send_text(app, MAV_SEVERITY_WARNING, "not saved: this board keeps no parameters", "");
    return MAV_RESULT_FAILED;
}

uint8_t esea_parameters_storage(esea_app_t *app, float action)
{
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
    return (uint8_t)(put_in_force(app) ? MAV_RESULT_ACCEPTED : MAV_RESULT_FAILED);
}
