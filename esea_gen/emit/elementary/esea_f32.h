#ifndef ESEA_F32_H
#define ESEA_F32_H
#include <stdint.h>
#ifdef __cplusplus
extern "C" {
#endif
float esea_f32_powk(float x, int32_t y_q27);
float esea_f32_pow(float x, float y);
float esea_f32_exp(float x);
float esea_f32_expm1(float x);
float esea_f32_log(float x);
float esea_f32_log1p(float x);
float esea_f32_tanh(float x);
float esea_f32_cbrt(float x);
float esea_f32_sqrt(float x);
float esea_f32_sin(float x);
float esea_f32_cos(float x);
float esea_f32_atan2(float y, float x);
#ifdef __cplusplus
}
#endif
#endif
