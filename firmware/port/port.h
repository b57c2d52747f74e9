/* The hardware, as the application sees it.  A board fills in one of these structs; nothing else of
 * it is visible above.
 *
 * License: MIT. */
#ifndef ESEA_PORT_H
#define ESEA_PORT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

typedef struct {
    /* Name of the board, at most 15 characters. */
    const char *name;
    /* Size of the receive buffer and of the stack, bytes. */
    uint32_t receive_buffer_bytes;
    uint32_t stack_bytes;
    /* Takes up to `capacity` received bytes; returns how many there were.  Never waits. */
    size_t (*read)(uint8_t *bytes, size_t capacity);
    /* Sends all bytes; returns when the last one has been handed to the hardware. */
    void (*write)(const uint8_t *bytes, size_t count);
    /* Sleeps until something may have been received; may return early. */
    void (*wait)(void);
    /* A free-running counter of 32 bits, for measuring; 0 on a board without one. */
    uint32_t (*ticks)(void);
    /* Holds interrupts off while `on`: what is measured in between is the step and nothing else. */
    void (*quiet)(bool on);
    /* Bytes that found the receive buffer full, since boot. */
    uint32_t (*lost_bytes)(void);
    /* Most of the stack that was in use since boot, bytes. */
    uint32_t (*stack_peak_bytes)(void);
} esea_port_t;

#endif
