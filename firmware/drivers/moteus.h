/* A moteus drive (mjbots) by its register protocol: frames of CAN-FD, and the lines of text in which an fdcanusb
 * adapter carries them.  No I/O: a board sends and receives.  Positions are revolutions, torques those of the
 * drive's output.
 *
 * License: MIT. */
#ifndef ESEA_MOTEUS_H
#define ESEA_MOTEUS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define ESEA_MOTEUS_FRAME_BYTES 64u
#define ESEA_MOTEUS_LINE_BYTES 160u
#define ESEA_MOTEUS_REGISTERS 5 /* version of the register map that this file knows */
#define ESEA_MOTEUS_SLOTS 3u    /* encoders */
#define ESEA_MOTEUS_EMULATED 24154 /* model: none of the maker's */

typedef enum {
    ESEA_MOTEUS_STOPPED = 0,
    ESEA_MOTEUS_FAULT = 1,
    ESEA_MOTEUS_POSITION = 10, /* in which a pure torque is commanded, too */
    ESEA_MOTEUS_TIMEOUT = 11
} esea_moteus_mode_t;

/* What the drive has told; NaN for what it has not. */
typedef struct {
    float mode, output_rev, output_rev_s, torque_Nm, slot_rev[ESEA_MOTEUS_SLOTS], valid, voltage_V, motor_C, board_C, fault,
            counter, model, registers;
    uint32_t replies; /* that held at least the mode */
    uint32_t refused; /* registers that the drive does not know, or would not take */
} esea_moteus_t;

void esea_moteus_start(esea_moteus_t *drive);

/* The frame that commands a torque, of at most `most_Nm` and for `watchdog_s` only, or the stop, and asks for what
 * esea_moteus_t holds; returns its bytes.  A torque or a time that is no number, and a time without end, stop. */
size_t esea_moteus_command(uint8_t *frame, bool on, float torque_Nm, float most_Nm, float watchdog_s);

/* The frame that asks for model and version of the register map. */
size_t esea_moteus_ask_version(uint8_t *frame);

/* Takes a reply; false for one that is cut off or of another form, of which nothing is kept. */
bool esea_moteus_take(esea_moteus_t *drive, const uint8_t *frame, size_t count);

/* Diagnostic channel: text to the drive, a request for its text, and the text in a reply (NULL: none). */
size_t esea_moteus_say(uint8_t *frame, const char *text);
size_t esea_moteus_listen(uint8_t *frame);
const char *esea_moteus_text(const uint8_t *frame, size_t count, size_t *length);

/* Whether the drive limits what it was told to give: then its torque is not the one commanded. */
bool esea_moteus_limits(const esea_moteus_t *drive);

/* Lines of an adapter: `can send ID HEX\n`, and a frame out of `rcv ID HEX ...` (0 bytes for any other line). */
size_t esea_moteus_line(char *line, uint16_t id, const uint8_t *frame, size_t count);
size_t esea_moteus_heard(const char *line, uint16_t *id, uint8_t *frame);

#endif
