/* Who may command: once the board has been given a key, whoever signs with it.  The signatures are
 * MAVLink's own; a stop needs none.
 *
 * License: MIT. */
#include "app.h"

#include <string.h>

static void pair(esea_app_t *app, bool on)
{
    app->signing.paired = on;
    app->receiving.signing = on ? &app->signing.key : NULL;
    app->receiving.signing_streams = on ? &app->signing.streams : NULL;
}

void esea_signing_start(esea_app_t *app)
{
    esea_signing_t *const signing = &app->signing;

    pair(app, esea_kept_key(app, signing->key.secret_key, &signing->key.timestamp));
}

void esea_signing_setup(esea_app_t *app, const mavlink_message_t *message)
{
    static const uint8_t none[MAVLINK_MSG_SETUP_SIGNING_FIELD_SECRET_KEY_LEN];
    esea_signing_t *const signing = &app->signing;
    mavlink_setup_signing_t asked;
    bool on, kept;

    mavlink_msg_setup_signing_decode(message, &asked);
    if (!esea_meant(asked.target_system, asked.target_component))
        return;
    on = memcmp(asked.secret_key, none, sizeof none) != 0;
    if (esea_state_drives(app->state) || (!on && !signing->paired)) {
        esea_send_text(app, MAV_SEVERITY_WARNING, "key refused in state ",
                esea_link_state_name((uint32_t)app->state));
        return;
    }
    memcpy(signing->key.secret_key, asked.secret_key, sizeof signing->key.secret_key);
    /* Never back: what was signed before stays old. */
    if (asked.initial_timestamp > signing->key.timestamp)
        signing->key.timestamp = asked.initial_timestamp;
    pair(app, on);
    kept = esea_keep_key(app, signing->key.secret_key, signing->key.timestamp);
    esea_send_text(app, MAV_SEVERITY_INFO, on ? "paired" : "no longer paired", kept ? "" : ", until power-off");
}

/* Commands that came in haste, one after the other, are only counted. */
static void say(esea_app_t *app, const mavlink_message_t *message)
{
    mavlink_param_set_t asked;

    if (message->msgid == MAVLINK_MSG_ID_COMMAND_LONG) {
        esea_send_ack(app, message, mavlink_msg_command_long_get_command(message), MAV_RESULT_DENIED);
    } else if (message->msgid == MAVLINK_MSG_ID_PARAM_SET) {
        mavlink_msg_param_set_decode(message, &asked);
        esea_parameters_error(app, message, asked.param_id, -1, MAV_PARAM_ERROR_PERMISSION_DENIED);
    } else if (message->msgid != MAVLINK_MSG_ID_ESEA_STREAM && message->msgid != MAVLINK_MSG_ID_SETUP_SIGNING) {
        return;
    }
    esea_send_text(app, MAV_SEVERITY_WARNING, "refused: this board is paired, sign with its key", "");
}

void esea_signing_refuse(esea_app_t *app, const mavlink_message_t *message)
{
    esea_signing_t *const signing = &app->signing;

    if ((message->incompat_flags & MAVLINK_IFLAG_SIGNED) == 0u)
        esea_count(&signing->unsigned_refused);
    else if (signing->key.last_status == MAVLINK_SIGNING_STATUS_BAD_SIGNATURE)
        esea_count(&signing->bad);
    else
        esea_count(&signing->replayed);
    say(app, message);
}
