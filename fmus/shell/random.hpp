// Seeded, bounded normal noise whose whole state is four words, so that it can live inside a Model.
#pragma once

#include <cmath>
#include <cstdint>

namespace rotordx {

/// xoshiro256++ (Blackman and Vigna, 2021), seeded through splitmix64, with normal numbers by inversion.
///
/// A normal number costs one draw, whatever its value, so that noise of one quantity never shifts that of another.
class Random {
 public:
  /// Noise is cut at this many standard deviations (exactly: the truncated normal distribution, whose own standard
  /// deviation is 0.99993). Assumption 1 of paper 000, and every threshold that follows from it, is about *bounded*
  /// uncertainty; untruncated noise would break it with a probability that depends on the length of the flight.
  static constexpr double kTruncation = 4.5;

  Random() = default;

  /// `seed` is a whole number of a scenario; `stream` keeps FMUs with the same seed apart.
  Random(double seed, std::uint64_t stream) {
    std::uint64_t counter = static_cast<std::uint64_t>(seed) ^ stream;
    for (std::uint64_t& word : state_) {
      std::uint64_t mixed = counter += 0x9e3779b97f4a7c15;
      mixed = (mixed ^ (mixed >> 30)) * 0xbf58476d1ce4e5b9;
      mixed = (mixed ^ (mixed >> 27)) * 0x94d049bb133111eb;
      word = mixed ^ (mixed >> 31);
    }
  }

  /// Standard normal number, truncated.
  double normal() {
    constexpr double kTail = 3.3976731247300535e-6;  // probability below -kTruncation
    return quantile((1.0 - 2.0 * kTail) * (uniform() - 0.5));
  }

 private:
  static std::uint64_t rotate(std::uint64_t word, int bits) { return (word << bits) | (word >> (64 - bits)); }

  /// In (0, 1), symmetric about 1/2.
  double uniform() {
    const std::uint64_t result = rotate(state_[0] + state_[3], 23) + state_[0];
    const std::uint64_t shifted = state_[1] << 17;
    state_[2] ^= state_[0];
    state_[3] ^= state_[1];
    state_[1] ^= state_[2];
    state_[0] ^= state_[3];
    state_[2] ^= shifted;
    state_[3] = rotate(state_[3], 45);
    return (static_cast<double>(result >> 12) + 0.5) * 0x1p-52;
  }

  /// Normal quantile of the probability 1/2 + q by algorithm AS 241 (Wichura, Applied Statistics 37, 1988), relative
  /// error about 1e-16. The paper's third branch serves probabilities below 1e-11, which truncation rules out.
  static double quantile(double q) {
    if (std::fabs(q) <= 0.425) {
      return q *
             ratio(
                 0.180625 - q * q,
                 {3.3871328727963666080e0, 1.3314166789178437745e2, 1.9715909503065514427e3, 1.3731693765509461125e4,
                  4.5921953931549871457e4, 6.7265770927008700853e4, 3.3430575583588128105e4, 2.5090809287301226727e3},
                 {1.0, 4.2313330701600911252e1, 6.8718700749205790830e2, 5.3941960214247511077e3,
                  2.1213794301586595867e4, 3.9307895800092710610e4, 2.8729085735721942674e4, 5.2264952788528545610e3});
    }
    return std::copysign(ratio(std::sqrt(-std::log(0.5 - std::fabs(q))) - 1.6,
                               {1.42343711074968357734e0, 4.63033784615654529590e0, 5.76949722146069140550e0,
                                3.64784832476320460504e0, 1.27045825245236838258e0, 2.41780725177450611770e-1,
                                2.27238449892691845833e-2, 7.74545014278341407640e-4},
                               {1.0, 2.05319162663775882187e0, 1.67638483018380384940e0, 6.89767334985100004550e-1,
                                1.48103976427480074590e-1, 1.51986665636164571966e-2, 5.47593808499534494600e-4,
                                1.05075007164441684324e-9}),
                         q);
  }

  /// Quotient of two polynomials, coefficients in ascending order.
  static double ratio(double x, const double (&numerator)[8], const double (&denominator)[8]) {
    double above = numerator[7], below = denominator[7];
    for (int i = 6; i >= 0; --i) {
      above = above * x + numerator[i];
      below = below * x + denominator[i];
    }
    return above / below;
  }

  std::uint64_t state_[4] = {};
};

}  // namespace rotordx
