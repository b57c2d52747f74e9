/* Power on: non-volatile data, the key for commands, the self-test.
 *
 * License: MIT. */
#include "app.h"

#include <string.h>

void esea_app_init(esea_app_t *app, const esea_port_t *port)
{
    memset(app, 0, sizeof *app);
    app->port = port;
    if (port->store != NULL) {
        port->store->status = esea_store_open(port->store, port->flash, ESEA_LINK_DEVICE);
        esea_count(&port->store->set.use.starts);
        app->use_changed = true;
    }
    app->boot = port->unique;
    if (app->boot == 0u && port->store != NULL && port->store->status <= ESEA_STORE_LOADED)
        app->boot = port->store->set.use.starts;
    if (app->boot == 0u)
        app->boot = 1u;
    app->refused_ms = 0u - 1000u;
    esea_kept_lives(app);
    esea_signing_start(app);
    esea_keep_up(app); /* before anything is taken: the number of this start does not come again */
    esea_parameters_start(app);
    if (esea_app_reset(app))
        esea_send_heartbeat(app);
    if (port->notice != NULL)
        esea_send_text(app, MAV_SEVERITY_WARNING, port->notice, "");
    app->told = app->state;
}
