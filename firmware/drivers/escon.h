/* Motor: set-point of current to an ESCON 50/5 by the duty of a PWM, 10 to 90 %, 50 % for 0 A; its
 * enable line; and its actual current, read back as a voltage and compared with the set-point.
 *
 * License: MIT. */
#ifndef ESEA_ESCON_H
#define ESEA_ESCON_H

#include "hardware.h"

typedef struct {
    uint32_t pwm, enable_pin, adc;
    float Nm_A;        /* of the motor; negative where it turns the other way */
    float full_A;      /* at 90 % */
    float A_count;     /* of the converter; negative where it counts down */
    float zero_counts; /* of the converter at no current */
    uint32_t least_counts, most_counts; /* beyond: saturated, or the wire is off */
    /* Of what is held against the command. */
    float bound_Nm;    /* largest difference */
    float follow;      /* share of the way to a new command that the current goes in a tick at least */
    uint32_t ticks;    /* beyond the bound without a pause, until it is a fault */
} esea_escon_config_t;

typedef struct {
    float low_Nm, high_Nm; /* between them lies a current that follows */
    float measured_Nm;
    uint32_t beyond;
    bool on;
} esea_escon_t;

/* Switches it off. */
void esea_escon_start(esea_escon_t *motor, const esea_escon_config_t *config, const esea_hardware_t *hardware);

/* What the motor is to give; what is no number switches it off. */
void esea_escon_drive(esea_escon_t *motor, const esea_escon_config_t *config, const esea_hardware_t *hardware,
        float u_Nm, bool enable);

/* Once a tick, with what was set last: whether the current has not been what was set for too long.  A
 * tick beyond the bound weighs as much as two within, so that one in two is found as well, in four times the
 * ticks.  A motor that is off is not asked: an amplifier without supply says anything. */
bool esea_escon_wrong(esea_escon_t *motor, const esea_escon_config_t *config, const esea_hardware_t *hardware,
        float u_Nm);

#endif
