/* Use of the couplings: cycles of their deflection, absorbed energy, and time.
 *
 * License: MIT. */
#include "app.h"
#include "rainflow.h"

#define STILL_S 10u /* at rest for so long: a save disturbs nobody */
#define SAVE_S 60u  /* what is counted between two saves at rest, at least */

/* Energy in whole joules and a part, so that small steps are not lost beside what has come together. */
static void absorb(esea_store_life_t *life, float energy_J)
{
    life->part_J += energy_J;
    if (life->part_J >= 1.0f) {
        life->part_J -= 1.0f;
        esea_count(&life->joules);
    } else if (life->part_J <= -1.0f && life->joules > 0u) {
        life->part_J += 1.0f;
        --life->joules;
    }
}

void esea_life_tick(esea_app_t *app)
{
    const uint32_t second = esea_ticks(1000u);
    const uint32_t couplings = ESEA_LINK_COUPLINGS; /* in a variable: there may be none */
    uint32_t number;

    for (number = 0u; number < couplings; ++number) {
        esea_life_t *const life = &app->life[number];
        const float most_rad = esea_link_coupling_rad(number);
        float theta_rad, tau_Nm;

        if (!app->referenced || app->state == ESEA_STATE_ZEROING ||
            !esea_link_coupling(number, app->in, app->out, &theta_rad, &tau_Nm) ||
            !(theta_rad >= -most_rad && theta_rad <= most_rad) || tau_Nm - tau_Nm != 0.0f) {
            life->known = false;
            continue;
        }
        if (life->known)
            absorb(&life->kept, 0.5f * (tau_Nm + life->tau_Nm) * (theta_rad - life->theta_rad));
        life->known = true;
        life->theta_rad = theta_rad;
        life->tau_Nm = tau_Nm;
        theta_rad *= (float)ESEA_LIFE_TOP / most_rad;
        if (esea_rainflow_take(&life->kept, (int32_t)(theta_rad + (theta_rad < 0.0f ? -0.5f : 0.5f))))
            life->still = 0u;
        if (life->still < STILL_S * second)
            ++life->still;
        if (++life->ticks >= second) {
            life->ticks = 0u;
            esea_count(&life->kept.seconds);
            esea_count(&life->unsaved_s);
        }
        if (life->unsaved_s >= SAVE_S && life->still >= STILL_S * second)
            app->use_changed = true;
    }
}
