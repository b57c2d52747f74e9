/* Black box: inputs, commands and outputs of the board at each tick of the last two seconds, in memory
 * that a reset does not change.  It is frozen at a fault, or if the board was reset while the motor was on,
 * until the host releases it or the motor is armed again.
 *
 * Every record has its own check: a reset in the middle of one loses that one.  After a power cut the
 * memory may have any content, which is then rejected.
 *
 * License: MIT. */
#ifndef ESEA_BLACKBOX_H
#define ESEA_BLACKBOX_H

#include <stdbool.h>
#include <stdint.h>

#include "states.h"
#include ESEA_LINK_HEADER

#define ESEA_BLACKBOX_MS 2000u
#ifndef ESEA_BLACKBOX_BYTES /* that the board has for records: a smaller one remembers less */
#define ESEA_BLACKBOX_BYTES UINT32_MAX
#endif

/* Of what is wanted the whole numbers are packed into a byte; a device without a motor has none. */
#define ESEA_BLACKBOX_PACKED (ESEA_LINK_AXES > 0u ? 3u : 0u)
#define ESEA_BLACKBOX_DESIRED (sizeof(esea_link_wanted_t) / sizeof(float) - ESEA_BLACKBOX_PACKED)

#define ESEA_BLACKBOX_ON 0x40u   /* the motor was on */
#define ESEA_BLACKBOX_STOP 0x80u /* a stop was held, or the stop line open */
#define ESEA_BLACKBOX_ASKED 0x3Fu /* the limits were told: mode, stop << 2, rearm << 3 */

#define ESEA_BLACKBOX_AXES (ESEA_LINK_AXES > 0u ? ESEA_LINK_AXES : 1u)

/* A tick. */
typedef struct {
    uint32_t check;
    uint16_t serial, tick; /* of either the lower half */
    uint8_t state, fault;
    uint8_t flags;
    uint8_t faults[1u + (ESEA_BLACKBOX_AXES + 2u) / 4u * 4u]; /* of the limits, by axis; whole words to their end */
    float u_Nm[ESEA_BLACKBOX_AXES];                           /* to the motors */
    float desired[ESEA_BLACKBOX_DESIRED];
    float measured[ESEA_LINK_MEASURED]; /* in the order of the drivers */
} esea_blackbox_record_t;

#define ESEA_BLACKBOX_WHOLE (ESEA_BLACKBOX_MS * UINT32_C(1000) / ESEA_LINK_TICK_US)
#define ESEA_BLACKBOX_FIT ((uint32_t)(ESEA_BLACKBOX_BYTES / sizeof(esea_blackbox_record_t)))
#define ESEA_BLACKBOX_RECORDS (ESEA_BLACKBOX_FIT < ESEA_BLACKBOX_WHOLE ? ESEA_BLACKBOX_FIT : ESEA_BLACKBOX_WHOLE)

typedef struct esea_blackbox {
    uint32_t layout; /* of the firmware that wrote it */
    uint32_t epoch;  /* records of another are none */
    uint32_t frozen;
    uint32_t fault, tick; /* at which it was frozen */
    uint32_t check;       /* of the above */
    uint32_t next, count; /* place of the next record; how many there are */
    uint16_t serial;
    esea_blackbox_record_t records[ESEA_BLACKBOX_RECORDS];
} esea_blackbox_t;

/* After power-up and every reset.  What is there is kept where it is frozen, and is frozen now where the
 * motor was on; `fault`: why the board was reset, if that was a fault (it then is frozen too), else 0. */
void esea_blackbox_start(esea_blackbox_t *box, uint32_t fault);

/* Puts in what was wanted. */
void esea_blackbox_want(esea_blackbox_record_t *record, const esea_link_wanted_t *wanted);

/* Adds what a tick was; check and serial are put in.  A frozen box takes nothing. */
void esea_blackbox_add(esea_blackbox_t *box, esea_blackbox_record_t *record);

/* Freezes it; the first fault stays. */
void esea_blackbox_freeze(esea_blackbox_t *box, uint32_t fault, uint32_t tick);

/* Forgets all and records again. */
void esea_blackbox_release(esea_blackbox_t *box);

bool esea_blackbox_frozen(const esea_blackbox_t *box);

/* Records of a frozen box; 0 while it runs. */
uint32_t esea_blackbox_count(const esea_blackbox_t *box);

/* Record by index, the oldest is 0; false when there is none, or its memory has changed since. */
bool esea_blackbox_read(const esea_blackbox_t *box, uint32_t index, esea_blackbox_record_t *record);

#endif
