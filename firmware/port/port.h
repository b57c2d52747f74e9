/* The hardware, as the application sees it.  A board fills in one of these structs; nothing else of
 * it is visible above.
 *
 * License: MIT. */
#ifndef ESEA_PORT_H
#define ESEA_PORT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct esea_blackbox;
struct esea_store;

#define ESEA_FLASH_UNIT_MOST 32u

/* Flash for what outlasts the power, in areas that are erased as a whole: an erased byte is 0xFF, a write
 * only clears bits. */
typedef struct {
    uint32_t area_bytes;
    /* Must return where a write was cut, with any bytes (flash with ECC: its trap is caught). */
    void (*read)(uint32_t area, uint32_t at, void *to, size_t count);
    /* False when it failed.  Addresses and counts are whole units, each written once between erasures. */
    bool (*write)(uint32_t area, uint32_t at, const void *from, size_t count);
    bool (*erase)(uint32_t area);
    /* What is programmed at once, a power of two: 4 on an STM32F4, 8 on an STM32G4 or L4, 32 on an STM32H7; 0: 4. */
    uint32_t unit_bytes;
} esea_flash_t;

typedef struct {
    /* Name of the board, at most 15 characters. */
    const char *name;
    /* What the board has to say at its start, at most 50 characters; NULL: nothing. */
    const char *notice;
    /* Size of the receive buffer and of the stack, bytes. */
    uint32_t receive_buffer_bytes;
    uint32_t stack_bytes;
    /* Takes up to `capacity` received bytes; returns how many there were.  Never waits. */
    size_t (*read)(uint8_t *bytes, size_t capacity);
    /* Sends all bytes of a message; returns when the last one has been handed to the hardware, or to a queue, or
     * when it found no room there and none of it goes. */
    void (*write)(const uint8_t *bytes, size_t count);
    /* Whether the line takes what may wait, which is telemetry; NULL: always, for writing waits. */
    bool (*room)(void);
    /* Sleeps until something may have been received; may return early, or at once. */
    void (*wait)(void);
    /* A free-running counter of 32 bits, for measuring; 0 on a board without one. */
    uint32_t (*ticks)(void);
    /* Its ticks in a base tick, to find one that was lost; 0 where that cannot be said. */
    uint32_t base_ticks;
    /* Holds interrupts off while `on`: nothing comes in between. */
    void (*quiet)(bool on);
    /* Asks for esea_app_background, which runs when nothing above it does. */
    void (*pend)(void);
    /* Bytes that found the receive buffer full, since boot. */
    uint32_t (*lost_bytes)(void);
    /* Most of the stack that was in use since boot, bytes. */
    uint32_t (*stack_peak_bytes)(void);

    /* The drivers; each is NULL where there is none. */

    /* What is measured at a base tick, in the device's order (ESEA_LINK_MEASURED_...).  Without a
     * driver every value is NaN, which no Block takes as valid. */
    void (*sample)(float *measured);
    /* The motors: the torque of each at its shaft, in the order of the axes, and whether they are on.  At every base
     * tick. */
    void (*motor)(const float *u_Nm, bool enable);
    /* Whether the stop line, normally closed, is open. */
    bool (*stop_open)(void);
    /* A fault that the drivers have found since they were asked last, a number of ESEA_FAULT, else 0; at
     * every base tick, and once before the first: what reset the board. */
    uint32_t (*trouble)(void);
    /* Keeps the watchdog from resetting the board; the first call starts it. */
    void (*feed)(void);
    /* Memory that a reset leaves as it is. */
    struct esea_blackbox *blackbox;
    /* A number that is another at every start, where no store counts them; 0: none. */
    uint32_t unique;
    /* What outlasts the power, and the flash that it is in; NULL where there is none. */
    struct esea_store *store;
    const esea_flash_t *flash;
} esea_port_t;

/* Fills in the drivers that the board has (boards/<name>/drivers.c); the others stay NULL. */
void esea_board_drivers(esea_port_t *port);

#endif
