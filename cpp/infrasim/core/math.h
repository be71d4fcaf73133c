#pragma once

#include <sleef.h>

#include <cmath>
#include <cstddef>
#include <span>
#include <utility>

// Elementary functions that give the same bits on every x86-64 processor. The functions of the C
// library do not, because their implementation depends on the processor (with or without fused
// multiply-add). The code of the simulator therefore uses these functions in place of those of
// <cmath>. Square roots, rounding and fmod are exact and may come from <cmath>.

namespace infrasim::math {

inline double sin(double x) { return Sleef_cinz_sind1_u10purec(x); }
inline double cos(double x) { return Sleef_cinz_cosd1_u10purec(x); }
inline std::pair<double, double> cos_sin(double x) {
  const Sleef_double_2 both = Sleef_cinz_sincosd1_u10purec(x);
  return {both.y, both.x};
}
inline double tan(double x) { return Sleef_cinz_tand1_u10purec(x); }
inline double asin(double x) { return Sleef_cinz_asind1_u10purec(x); }
inline double atan(double x) { return Sleef_cinz_atand1_u10purec(x); }
inline double atan2(double y, double x) { return Sleef_cinz_atan2d1_u10purec(y, x); }
inline double exp(double x) { return Sleef_cinz_expd1_u10purec(x); }
inline double log(double x) { return Sleef_cinz_logd1_u10purec(x); }
inline double pow(double x, double y) { return Sleef_cinz_powd1_u10purec(x, y); }
inline double erfc(double x) { return Sleef_cinz_erfcd1_u15purec(x); }

inline float sin(float x) { return Sleef_cinz_sinf1_u10purec(x); }
inline float cos(float x) { return Sleef_cinz_cosf1_u10purec(x); }
inline float asin(float x) { return Sleef_cinz_asinf1_u10purec(x); }
inline float log(float x) { return Sleef_cinz_logf1_u10purec(x); }

/// Replaces each value by its exponential. Two values are computed at once. The results have the
/// same bits as those of `exp`.
inline void exp_all(std::span<double> values) {
  std::size_t i = 0;
  for (; i + 2 <= values.size(); i += 2)
    _mm_storeu_pd(&values[i], Sleef_cinz_expd2_u10sse2(_mm_loadu_pd(&values[i])));
  for (; i < values.size(); ++i) values[i] = exp(values[i]);
}

/// Returns the length of a vector, without protection from overflow and underflow of the squares.
/// Lengths in metres need no protection.
inline double hypot(double x, double y) { return std::sqrt(x * x + y * y); }
inline float hypot(float x, float y) { return std::sqrt(x * x + y * y); }

}  // namespace infrasim::math
