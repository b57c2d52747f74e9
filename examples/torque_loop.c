/* Worked example: the generated torque sensor in a program of your own.  It prints a table of
 * deflection and torque, 2 s at 1 kHz; docs/first-firmware.md compiles and runs it. */
#include <math.h>
#include <stdio.h>

#include "esea_elbow.h"

int main(void)
{
    esea_elbow_params_t params;
    esea_elbow_coeffs_t coeffs;
    esea_elbow_state_t state;
    esea_elbow_sense_in_t in;
    esea_elbow_sense_out_t out;
    int k;

    esea_elbow_default_params(&params);
    if (esea_elbow_prepare(&params, &coeffs) != 0u) /* once, and when a tunable changes */
        return 1;
    esea_elbow_init(&coeffs, &state);

    printf("theta_rad,tau_Nm\n");
    for (k = 0; k < 2000; ++k) { /* on a board: a timer interrupt every millisecond */
        in.theta_rad = (float)(0.15 * sin(6.2831853 * 0.001 * k)); /* your encoders' difference */
        esea_elbow_sense_step(&coeffs, &state, &in, &out);
        if (out.sensor_status & ESEA_ELBOW_SENSOR_INPUT_INVALID)
            return 2;
        printf("%.7f,%.7f\n", (double)in.theta_rad, (double)out.tau_Nm);
    }
    return 0;
}
