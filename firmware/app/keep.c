/* What outlasts the power, between the store and those who use it: parameters by their keys, and who may
 * command.  A board without a store keeps nothing.
 *
 * License: MIT. */
#include "app.h"
#include "store.h"

#include <string.h>

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
    return esea_store_save(app->port->store, kept, count);
}

bool esea_kept_parameters(esea_app_t *app, float *values)
{
    const esea_store_t *const store = app->port->store;
    uint32_t i, k;

    if (store == NULL || store->status != ESEA_STORE_LOADED)
        return false;
    for (k = 0u; k < store->set.parameters && k < ESEA_STORE_PARAMETERS; ++k)
        for (i = 0u; i < ESEA_LINK_PARAMETERS; ++i)
            if (esea_link_parameter(i)->key == store->set.parameter[k].id)
                values[i] = store->set.parameter[k].value;
    return true;
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
    return esea_store_commit(store);
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
