/* Non-volatile data, between the store and its users: parameters by their keys, zeros by the serial numbers
 * of the encoders, counters, the use of each coupling, and the key for commands.  A board without a store keeps
 * nothing.
 *
 * License: MIT. */
#include "app.h"
#include "store.h"

#include <string.h>

/* How many couplings are counted; in a variable, for a device may have none. */
static const uint32_t couplings = ESEA_LINK_COUPLINGS;

/* The record of a coupling, or one that is free for it; NULL for neither.  `place`: as it stands in the record, 0
 * for one that lies aside, which its serial number tells from others. */
static esea_store_life_t *record_of(esea_store_t *store, uint32_t place, uint32_t serial)
{
    esea_store_life_t *found = NULL;
    uint32_t i;

    for (i = ESEA_STORE_LIVES; i > 0u; --i) {
        esea_store_life_t *const life = &store->set.life[i - 1u];

        if (life->place == place && (place != 0u || life->serial == serial))
            return life;
        if (life->place == 0u && life->serial == 0u)
            found = life;
    }
    return found;
}

/* What is counted goes into the set that is saved, each coupling's whole. */
static void take_lives(esea_app_t *app)
{
    uint32_t i;

    for (i = 0u; i < couplings; ++i) {
        esea_store_life_t *const life = record_of(app->port->store, i + 1u, 0u);

        if (life == NULL)
            continue;
        app->port->quiet(true);
        *life = app->life[i].kept;
        app->life[i].unsaved_s = 0u;
        app->port->quiet(false);
        life->place = i + 1u;
    }
}

static bool commit(esea_app_t *app)
{
    take_lives(app);
    return esea_store_commit(app->port->store);
}

void esea_kept_lives(esea_app_t *app)
{
    esea_store_t *const store = app->port->store;
    uint32_t i;

    for (i = 0u; store != NULL && i < couplings; ++i) {
        const esea_store_life_t *const life = record_of(store, i + 1u, 0u);

        if (life == NULL)
            continue;
        app->life[i].kept = *life;
        if (life->points > ESEA_LIFE_POINTS) /* whole by its checksum, and no firmware wrote it */
            app->life[i].kept.points = 0u;
    }
}

static uint8_t forget_coupling(esea_app_t *app, uint32_t serial)
{
    esea_store_life_t *const life = record_of(app->port->store, 0u, serial);

    if (life == NULL || life->serial != serial)
        return MAV_RESULT_DENIED;
    memset(life, 0, sizeof *life);
    return (uint8_t)(commit(app) ? MAV_RESULT_ACCEPTED : MAV_RESULT_FAILED);
}

uint8_t esea_keep_coupling(esea_app_t *app, uint32_t coupling, uint32_t serial)
{
    esea_store_life_t *found, *fitted;
    uint32_t i;

    if (app->port->store == NULL || (coupling >= couplings && coupling != UINT8_MAX))
        return MAV_RESULT_UNSUPPORTED;
    if (esea_state_drives(app->state))
        return MAV_RESULT_TEMPORARILY_REJECTED;
    for (i = 0u; i < couplings; ++i)
        if (serial == 0u || (i != coupling && app->life[i].kept.serial == serial))
            return MAV_RESULT_DENIED;
    if (coupling == UINT8_MAX)
        return forget_coupling(app, serial);
    /* What was counted before anybody said which coupling it is, is its own. */
    if (app->life[coupling].kept.serial != 0u && app->life[coupling].kept.serial != serial) {
        take_lives(app);
        fitted = record_of(app->port->store, coupling + 1u, 0u);
        found = record_of(app->port->store, 0u, serial);
        if (fitted == NULL || found == NULL)
            return MAV_RESULT_DENIED;
        fitted->place = 0u;
        found->place = coupling + 1u;
        app->port->quiet(true);
        memset(&app->life[coupling], 0, sizeof app->life[coupling]);
        app->life[coupling].kept = *found;
        app->port->quiet(false);
    }
    app->life[coupling].kept.serial = serial;
    return (uint8_t)(commit(app) ? MAV_RESULT_ACCEPTED : MAV_RESULT_FAILED);
}

bool esea_keep_parameters(esea_app_t *app)
{
    esea_store_parameter_t kept[ESEA_LINK_PARAMETERS + 1u];
    uint32_t i, count = 0u;

    if (app->port->store == NULL)
        return false;
    for (i = 0u; i < ESEA_LINK_PARAMETERS; ++i) {
        const esea_link_parameter_t *const parameter = esea_link_parameter(i);

        if (parameter->fixed)
            continue;
        kept[count].id = parameter->key;
        kept[count].value = esea_link_get(&app->control, i);
        ++count;
    }
    take_lives(app);
    return esea_store_save(app->port->store, kept, count);
}

uint32_t esea_kept_parameters(const esea_app_t *app, const esea_store_parameter_t **kept)
{
    const esea_store_t *const store = app->port->store;

    if (store == NULL || store->status != ESEA_STORE_LOADED)
        return 0u;
    *kept = store->set.parameter;
    return store->set.parameters < ESEA_STORE_PARAMETERS ? store->set.parameters : ESEA_STORE_PARAMETERS;
}

bool esea_keep_key(esea_app_t *app, const uint8_t *key, uint64_t timestamp)
{
    esea_store_t *const store = app->port->store;
    uint32_t i;

    if (store == NULL)
        return false;
    store->set.key.paired = 0u;
    for (i = 0u; i < sizeof store->set.key.secret; ++i)
        store->set.key.paired |= key[i] != 0u;
    memcpy(store->set.key.secret, key, sizeof store->set.key.secret);
    store->set.key.stamp[0] = (uint32_t)timestamp;
    store->set.key.stamp[1] = (uint32_t)(timestamp >> 32);
    return commit(app);
}

bool esea_kept_key(esea_app_t *app, uint8_t *key, uint64_t *timestamp)
{
    const esea_store_t *const store = app->port->store;

    if (store == NULL || store->status != ESEA_STORE_LOADED || store->set.key.paired == 0u)
        return false;
    memcpy(key, store->set.key.secret, sizeof store->set.key.secret);
    *timestamp = ((uint64_t)store->set.key.stamp[1] << 32) | store->set.key.stamp[0];
    return true;
}

/* How many encoders have a zero; in a variable, for a device may have none. */
static const uint32_t encoders = ESEA_LINK_ENCODERS;

/* What the board keeps of an encoder that is fitted; NULL for nothing. */
static const esea_store_encoder_t *known(const esea_app_t *app, uint32_t encoder)
{
    const esea_store_t *const store = app->port->store;

    return store != NULL && encoder < ESEA_STORE_ENCODERS ? esea_store_encoder(store, store->set.fitted[encoder]) : NULL;
}

bool esea_kept_zeros(esea_app_t *app)
{
    float zeros_rad[ESEA_LINK_ENCODERS + 1u];
    uint32_t i, count = 0u;

    for (i = 0u; i < encoders; ++i) {
        const esea_store_encoder_t *const encoder = known(app, i);

        if (encoder == NULL)
            break;
        zeros_rad[count++] = encoder->zero_rad;
    }
    app->zero = ESEA_ZERO_NONE;
    if (count == 0u || count < encoders || !esea_link_put_zeros(&app->control, zeros_rad))
        return esea_link_unzero(&app->control);
    app->zero = ESEA_ZERO_PUT_BACK;
    return true;
}

void esea_forget_zeros(esea_app_t *app)
{
    esea_store_t *const store = app->port->store;
    bool any = false;
    uint32_t i;

    app->zero_doubted = false;
    app->zero = ESEA_ZERO_NONE;
    for (i = 0u; store != NULL && i < ESEA_STORE_ENCODERS; ++i)
        any = esea_store_forget_encoder(store, store->set.fitted[i]) || any;
    if (any && commit(app))
        esea_send_text(app, MAV_SEVERITY_WARNING, "the kept zero is no longer used", "");
}

void esea_keep_zeros(esea_app_t *app)
{
    esea_store_t *const store = app->port->store;
    esea_store_encoder_t encoder;
    uint32_t i;

    app->zero = ESEA_ZERO_TAKEN;
    app->zero_doubted = false;
    for (i = 0u; store != NULL && i < encoders; ++i) {
        encoder.serial = i < ESEA_STORE_ENCODERS ? store->set.fitted[i] : 0u;
        encoder.zero_rad = esea_link_zero_of(&app->control, i);
        if (!esea_store_put_encoder(store, &encoder))
            return; /* nobody said which encoder it is: until power-off */
    }
    if (store != NULL && encoders > 0u && !commit(app))
        esea_send_text(app, MAV_SEVERITY_WARNING, "not saved: ", "the memory failed");
}

void esea_keep_up(esea_app_t *app)
{
    esea_store_t *const store = app->port->store;

    if (esea_state_drives(app->state) || app->state == ESEA_STATE_ZEROING || app->state == ESEA_STATE_REPLAY)
        return;
    if (app->zero_doubted) {
        const uint8_t zero = app->zero;

        esea_forget_zeros(app);
        app->zero = zero; /* what is in force stays so until a reset; the encoders themselves say no */
    }
    if (!app->use_changed)
        return;
    app->use_changed = false;
    /* Another firmware's set stays until somebody saves. */
    if (store != NULL && (store->status == ESEA_STORE_LOADED || store->status == ESEA_STORE_EMPTY))
        (void)commit(app);
}

uint8_t esea_keep_may_fit(const esea_app_t *app, const uint32_t *serials)
{
    uint32_t i, k;

    if (app->port->store == NULL || encoders == 0u)
        return MAV_RESULT_UNSUPPORTED;
    for (i = 0u; i < ESEA_STORE_ENCODERS; ++i)
        for (k = 0u; k < i; ++k)
            if (serials[i] != 0u && serials[i] == serials[k])
                return MAV_RESULT_DENIED;
    return MAV_RESULT_ACCEPTED;
}

void esea_keep_fitted(esea_app_t *app, const uint32_t *serials)
{
    esea_store_t *const store = app->port->store;
    uint32_t i;

    for (i = 0u; i < ESEA_STORE_ENCODERS; ++i)
        store->set.fitted[i] = i < encoders ? serials[i] : 0u;
    if (!commit(app))
        esea_send_text(app, MAV_SEVERITY_WARNING, "not saved: ", "the memory failed");
}
