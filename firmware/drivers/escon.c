/* License: MIT. */
#include "escon.h"

#define DUTY_NONE 5000.0f
#define DUTY_FULL 4000.0f /* from none to either end */

void esea_escon_start(esea_escon_t *motor, const esea_escon_config_t *config, const esea_hardware_t *hardware)
{
    motor->low_Nm = motor->high_Nm = motor->measured_Nm = 0.0f;
    motor->beyond = 0u;
    esea_escon_drive(motor, config, hardware, 0.0f, false);
}

void esea_escon_drive(esea_escon_t *motor, const esea_escon_config_t *config, const esea_hardware_t *hardware,
        float u_Nm, bool enable)
{
    float share = u_Nm / (config->Nm_A * config->full_A);

    motor->on = enable && share - share == 0.0f; /* false for NaN and infinity */
    if (!motor->on)
        share = 0.0f;
    if (share > 1.0f)
        share = 1.0f;
    if (share < -1.0f)
        share = -1.0f;
    /* Off goes first, on goes last: the set-point never counts before it is the right one. */
    if (!motor->on)
        hardware->put_pin(config->enable_pin, false);
    hardware->pwm(config->pwm, (uint32_t)(DUTY_NONE + DUTY_FULL * share + 0.5f));
    if (motor->on)
        hardware->put_pin(config->enable_pin, true);
}

/* The furthest that a current can lag behind, upward and downward: whatever goes to each new command at
 * least as fast stays between. */
static void expect(esea_escon_t *motor, const esea_escon_config_t *config, float u_Nm)
{
    motor->high_Nm += config->follow * (u_Nm - motor->high_Nm);
    motor->low_Nm += config->follow * (u_Nm - motor->low_Nm);
    if (motor->high_Nm < u_Nm)
        motor->high_Nm = u_Nm;
    if (motor->low_Nm > u_Nm)
        motor->low_Nm = u_Nm;
}

bool esea_escon_wrong(esea_escon_t *motor, const esea_escon_config_t *config, const esea_hardware_t *hardware,
        float u_Nm)
{
    uint32_t counts = 0u;
    bool fits;

    if (!motor->on) {
        motor->low_Nm = motor->high_Nm = 0.0f;
        motor->beyond = 0u;
        return false;
    }
    expect(motor, config, u_Nm);
    fits = hardware->adc(config->adc, &counts) && counts >= config->least_counts && counts <= config->most_counts;
    motor->measured_Nm = ((float)counts - config->zero_counts) * config->A_count * config->Nm_A;
    fits = fits && motor->measured_Nm <= motor->high_Nm + config->bound_Nm &&
           motor->measured_Nm >= motor->low_Nm - config->bound_Nm;
    if (!fits)
        motor->beyond += 2u;
    else if (motor->beyond > 0u)
        --motor->beyond;
    return motor->beyond >= 2u * config->ticks;
}
