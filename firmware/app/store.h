/* Non-volatile data: parameters, each encoder's zero, use counters, each coupling's life.  One set, in two areas
 * of flash, one of which always has the newest complete set: sets are added to an area until it is
 * full, then the other is erased and taken.  A set carries a number and a checksum, and its last word is
 * written last, so that a power cut at any byte of a write or an erasure leaves the old set or the new one.
 *
 * A set of another layout, older or newer, or of another device is refused and reported: the board then has
 * its defaults, without zeros.  Parameters are stored by the hash of their name: a new one has its default, a
 * removed one is ignored, so that neither changes the layout.
 *
 * Erasing may block the processor for a second: save while the motor is off.
 *
 * License: MIT. */
#ifndef ESEA_STORE_H
#define ESEA_STORE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "port.h"

#define ESEA_STORE_LAYOUT 3u /* 1 had a table of corrections, which nobody used; 2 no lives */
#ifndef ESEA_STORE_PARAMETERS /* tests have smaller sets */
#define ESEA_STORE_PARAMETERS 160u
#define ESEA_STORE_ENCODERS 4u
#endif
#ifndef ESEA_STORE_LIVES
#define ESEA_STORE_LIVES 4u
#define ESEA_LIFE_CLASSES 48u
#define ESEA_LIFE_POINTS 64u
#endif
#define ESEA_STORE_AREAS 2u

/* A parameter: FNV-1a of its full name, and its value. */
typedef struct {
    uint32_t id;
    float value;
} esea_store_parameter_t;

/* What a calibration found of an encoder, by the serial number that is on it; 0: none. */
typedef struct {
    uint32_t serial;
    float zero_rad;
} esea_store_encoder_t;

/* Counters; they stay at their maximum. */
typedef struct {
    uint32_t starts, armings, faults, watchdog_resets, saves;
    uint32_t active_s; /* with the motor on */
} esea_store_use_t;

/* What a coupling has borne (life.c, rainflow.c). */
typedef struct {
    uint32_t serial;  /* that is on it; 0: nobody said */
    uint32_t place;   /* 1 + the number of its axis; 0: it lies aside */
    uint32_t seconds; /* counted; these, joules and counts stay at their maximum */
    uint32_t joules;
    float part_J;
    uint32_t full; /* times that there was no room for a point */
    uint32_t points;
    int16_t point[ESEA_LIFE_POINTS]; /* what has not closed yet, in steps of the deflection */
    uint32_t halves[ESEA_LIFE_CLASSES]; /* half cycles that have closed, by class of range */
} esea_store_life_t;

/* Who may command. */
typedef struct {
    uint32_t paired; /* 0: anybody */
    uint32_t stamp[2]; /* time of the pairing, low word first: what was signed before it is old */
    uint8_t secret[32];
} esea_store_key_t;

typedef struct {
    uint32_t parameters; /* how many there are */
    esea_store_parameter_t parameter[ESEA_STORE_PARAMETERS];
    esea_store_encoder_t encoder[ESEA_STORE_ENCODERS];
    uint32_t fitted[ESEA_STORE_ENCODERS]; /* serial numbers, in the device's order; 0: nobody said */
    esea_store_use_t use;
    esea_store_key_t key;
    esea_store_life_t life[ESEA_STORE_LIVES];
} esea_store_set_t;

typedef enum {
    ESEA_STORE_EMPTY = 0,        /* nothing was ever saved, or nothing whole is left */
    ESEA_STORE_LOADED = 1,       /* the newest set is in memory */
    ESEA_STORE_OTHER_LAYOUT = 2, /* the newest is an older or newer firmware's */
    ESEA_STORE_OTHER_DEVICE = 3, /* the newest is another device's */
} ESEA_STORE_STATUS;

typedef struct esea_store {
    const esea_flash_t *flash;
    ESEA_STORE_STATUS status; /* since it was opened or saved to */
    uint32_t device;   /* hash of its name */
    uint32_t sequence; /* of the newest set, whoever's it is */
    uint32_t area, slot;
    bool found;
    esea_store_set_t set;
} esea_store_t;

/* Looks for the newest whole set; what is refused leaves an empty one in memory. */
ESEA_STORE_STATUS esea_store_open(esea_store_t *store, const esea_flash_t *flash, const char *device);

/* Saves the set that is in memory.  False: the old one stands. */
bool esea_store_commit(esea_store_t *store);

/* Replaces the parameters and saves.  False, and nothing changed, when there are too many, an id comes twice,
 * or a value is no finite number; false, too, when the flash fails. */
bool esea_store_save(esea_store_t *store, const esea_store_parameter_t *parameters, uint32_t count);

/* The parameters; returns how many, at most `capacity`. */
uint32_t esea_store_load(const esea_store_t *store, esea_store_parameter_t *parameters, uint32_t capacity);

/* What is known of an encoder, NULL for nothing. */
const esea_store_encoder_t *esea_store_encoder(const esea_store_t *store, uint32_t serial);

/* Takes it into memory, in place of what was known; the caller commits.  Where there is no room, one that is
 * not fitted makes it.  False when it is no encoder, or there is no room all the same. */
bool esea_store_put_encoder(esea_store_t *store, const esea_store_encoder_t *encoder);

/* What was known of it is wrong.  Whether anything was. */
bool esea_store_forget_encoder(esea_store_t *store, uint32_t serial);

#endif
