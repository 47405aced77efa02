// Vectors of 64 bytes, for one instruction set; where the machine's are narrower, the compiler splits them.
//
// No include guard: every translation unit has its own instruction set, and the functions are inlined there.

#include <cstdint>
#include <cstring>

#if defined(__clang__)
#define GMMJAX_UNROLL _Pragma("unroll")
#else
#define GMMJAX_UNROLL _Pragma("GCC unroll 16")
#endif

namespace gmmjax::GMMJAX_INSTRUCTION_SET {
namespace {

template <typename T>
struct Lanes;

template <>
struct Lanes<double> {
  typedef double Vector __attribute__((vector_size(64)));
  typedef int64_t Bits __attribute__((vector_size(64)));
  static constexpr int kCount = 8;
  // Adding it rounds to an integer, which then stands in the lowest bits.
  static constexpr double kRounding = 0x1.8p52;
  static constexpr int kMantissa = 52;
  static constexpr int64_t kBias = 1023;
  static constexpr double kLeast = -708;
  static constexpr double kLog2High = 0x1.62e42fee00000p-1, kLog2Low = 0x1.a39ef35793c76p-33;
  static constexpr int kLogTerms = 11;
};

template <>
struct Lanes<float> {
  typedef float Vector __attribute__((vector_size(64)));
  typedef int32_t Bits __attribute__((vector_size(64)));
  static constexpr int kCount = 16;
  static constexpr float kRounding = 0x1.8p23f;
  static constexpr int kMantissa = 23;
  static constexpr int32_t kBias = 127;
  static constexpr float kLeast = -87;
  static constexpr float kLog2High = 0x1.62e4p-1f, kLog2Low = 0x1.7f7d1cp-20f;
  static constexpr int kLogTerms = 5;
};

template <typename T>
using Vector = typename Lanes<T>::Vector;

template <typename T>
inline Vector<T> load(const T* from) {
  Vector<T> vector;
  std::memcpy(&vector, from, sizeof(vector));
  return vector;
}

template <typename T>
inline void store(T* to, Vector<T> vector) {
  std::memcpy(to, &vector, sizeof(vector));
}

template <typename T>
inline Vector<T> all(T value) {
  return Vector<T>{} + value;
}

template <typename To, typename From>
inline To bits_as(From from) {
  To to;
  static_assert(sizeof(to) == sizeof(from));
  std::memcpy(&to, &from, sizeof(to));
  return to;
}

// e^x for x <= 0, to the last digits: 2^n by the exponent's bits, e^r by its series, |r| <= log(2) / 2. The terms are
// added in pairs (Estrin's scheme), so that the chain of dependent operations is short.
template <typename T>
inline Vector<T> exponential(Vector<T> x) {
  using L = Lanes<T>;
  using Bits = typename L::Bits;
  x = x < L::kLeast ? all<T>(L::kLeast) : x;
  const Vector<T> rounded = x * T(1.44269504088896340736) + L::kRounding;
  const Vector<T> whole = rounded - L::kRounding;
  const Vector<T> rest = (x - whole * L::kLog2High) - whole * L::kLog2Low;
  const Vector<T> r2 = rest * rest, r4 = r2 * r2;
  const Vector<T> low = (T(1) + rest) + (T(1.0 / 2) + T(1.0 / 6) * rest) * r2;
  const Vector<T> middle = (T(1.0 / 24) + T(1.0 / 120) * rest) + (T(1.0 / 720) + T(1.0 / 5040) * rest) * r2;
  Vector<T> series = low + middle * r4;
  if constexpr (sizeof(T) == 8) {
    const Vector<T> high = (T(1.0 / 40320) + T(1.0 / 362880) * rest) +
                           (T(1.0 / 3628800) + T(1.0 / 39916800) * rest) * r2 + T(1.0 / 479001600) * r4;
    series = low + (middle + high * r4) * r4;
  }
  const Bits exponent = bits_as<Bits>(rounded) - bits_as<Bits>(all<T>(L::kRounding)) + L::kBias;
  return series * bits_as<Vector<T>>(exponent << L::kMantissa);
}

// log(x) for x >= 1: the exponent, and the series of log((1 + s) / (1 - s)) of the mantissa.
template <typename T>
inline Vector<T> logarithm(Vector<T> x) {
  using L = Lanes<T>;
  using Bits = typename L::Bits;
  const Bits one = bits_as<Bits>(all<T>(1));
  const Bits bits = bits_as<Bits>(x);
  Bits exponent = (bits - one) >> L::kMantissa;
  Vector<T> mantissa = bits_as<Vector<T>>(bits - (exponent << L::kMantissa));
  const auto large = mantissa > T(1.41421356237309504880);
  mantissa = large ? mantissa * T(0.5) : mantissa;
  exponent = large ? exponent + 1 : exponent;
  const Vector<T> s = (mantissa - T(1)) / (mantissa + T(1));
  const Vector<T> squared = s * s;
  Vector<T> series = all<T>(T(1.0 / (2 * L::kLogTerms + 1)));
  GMMJAX_UNROLL
  for (int term = L::kLogTerms - 1; term >= 0; --term) series = series * squared + T(1.0 / (2 * term + 1));
  const Vector<T> power = __builtin_convertvector(exponent, Vector<T>);
  return power * L::kLog2High + (power * L::kLog2Low + 2 * s * series);
}

template <typename T>
inline double sum(Vector<T> vector) {
  double total = 0;
  for (int lane = 0; lane < Lanes<T>::kCount; ++lane) total += vector[lane];
  return total;
}

}  // namespace
}  // namespace gmmjax::GMMJAX_INSTRUCTION_SET
