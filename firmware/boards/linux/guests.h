/* Further TCP clients beside the host: they receive the host's address, may send a stop, and are disconnected after
 * a second.
 *
 * License: MIT. */
#ifndef ESEA_GUESTS_H
#define ESEA_GUESTS_H

#include "app.h"

#define GUESTS_MOST 8u

/* `file`: a connection that does not wait. */
void guests_admit(esea_app_t *app, int file, const char *commander, uint64_t now_us);

/* Looks at what one of them said, by number; waits for nothing. */
void guests_attend(esea_app_t *app, uint32_t number, uint64_t now_us);

#endif
