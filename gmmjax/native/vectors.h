// Vectors of 64 bytes, for one instruction set: one of the machine's vectors, or two or four of them.
//
// Compilers split vectors that are wider than the machine's, too, but some into single numbers: GCC 12 computes a part of
// what it splits for AVX2 eight times, one lane after the other.
//
// GMMJAX_VECTOR_BYTES says how wide the machine's are. No include guard: every translation unit has its own instruction
// set, and the functions are inlined there.

#include <cstdint>
#include <cstring>
#include <type_traits>

#if defined(__clang__)
#define GMMJAX_UNROLL _Pragma("unroll")
#else
#define GMMJAX_UNROLL _Pragma("GCC unroll 16")
#endif
#define GMMJAX_INLINE inline __attribute__((always_inline))

namespace gmmjax::GMMJAX_INSTRUCTION_SET {
namespace {

constexpr int kVectorBytes = 64, kMachineBytes = GMMJAX_VECTOR_BYTES;

// Numbers of 64 bytes: two halves, down to one vector of the machine.
template <typename T, int kBytes = kVectorBytes>
struct Vector {
  Vector<T, kBytes / 2> low, high;

  GMMJAX_INLINE T operator[](int lane) const {
    constexpr int kHalf = kBytes / 2 / int(sizeof(T));
    return lane < kHalf ? low[lane] : high[lane - kHalf];
  }
};

template <typename T>
struct Vector<T, kMachineBytes> {
  typedef T Value __attribute__((vector_size(kMachineBytes)));
  Value value;

  GMMJAX_INLINE T operator[](int lane) const { return value[lane]; }
};

template <typename T>
struct Lanes;

template <>
struct Lanes<double> {
  using Integer = int64_t;
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
  using Integer = int32_t;
  static constexpr int kCount = 16;
  static constexpr float kRounding = 0x1.8p23f;
  static constexpr int kMantissa = 23;
  static constexpr int32_t kBias = 127;
  static constexpr float kLeast = -87;
  static constexpr float kLog2High = 0x1.62e4p-1f, kLog2Low = 0x1.7f7d1cp-20f;
  static constexpr int kLogTerms = 5;
};

template <>
struct Lanes<int64_t> {
  using Integer = int64_t;
};

template <>
struct Lanes<int32_t> {
  using Integer = int32_t;
};

// Integers as wide as the numbers; of a comparison all bits of a lane are 1 where it holds, else 0.
template <typename T, int kBytes = kVectorBytes>
using Bits = Vector<typename Lanes<T>::Integer, kBytes>;

// The same type, which no argument decides: a number of another type is converted.
template <typename T>
struct Given {
  using Type = T;
};
template <typename T>
using Number = typename Given<T>::Type;

template <typename T, int kBytes = kVectorBytes>
GMMJAX_INLINE Vector<T, kBytes> load(const T* from) {
  if constexpr (kBytes == kMachineBytes) {
    Vector<T, kBytes> vector;
    std::memcpy(&vector.value, from, sizeof(vector.value));
    return vector;
  } else {
    return {load<T, kBytes / 2>(from), load<T, kBytes / 2>(from + kBytes / 2 / sizeof(T))};
  }
}

template <typename T, int kBytes>
GMMJAX_INLINE void store(T* to, Vector<T, kBytes> vector) {
  if constexpr (kBytes == kMachineBytes) {
    std::memcpy(to, &vector.value, sizeof(vector.value));
  } else {
    store(to, vector.low);
    store(to + kBytes / 2 / sizeof(T), vector.high);
  }
}

template <typename T, int kBytes = kVectorBytes>
GMMJAX_INLINE Vector<T, kBytes> all(T value) {
  if constexpr (kBytes == kMachineBytes)
    return {typename Vector<T, kBytes>::Value{} + value};
  else
    return {all<T, kBytes / 2>(value), all<T, kBytes / 2>(value)};
}

#define GMMJAX_OPERATOR(op)                                                                  \
  template <typename T, int kBytes>                                                          \
  GMMJAX_INLINE Vector<T, kBytes> operator op(Vector<T, kBytes> a, Vector<T, kBytes> b) {    \
    if constexpr (kBytes == kMachineBytes)                                                   \
      return {a.value op b.value};                                                           \
    else                                                                                     \
      return {a.low op b.low, a.high op b.high};                                             \
  }                                                                                          \
  template <typename T, int kBytes>                                                          \
  GMMJAX_INLINE Vector<T, kBytes> operator op(Vector<T, kBytes> a, Number<T> b) {            \
    return a op all<T, kBytes>(b);                                                           \
  }                                                                                          \
  template <typename T, int kBytes>                                                          \
  GMMJAX_INLINE Vector<T, kBytes> operator op(Number<T> a, Vector<T, kBytes> b) {            \
    return all<T, kBytes>(a) op b;                                                           \
  }                                                                                          \
  template <typename T, int kBytes, typename Other>                                          \
  GMMJAX_INLINE Vector<T, kBytes>& operator op##=(Vector<T, kBytes>& a, Other b) {           \
    return a = a op b;                                                                       \
  }
GMMJAX_OPERATOR(+)
GMMJAX_OPERATOR(-)
GMMJAX_OPERATOR(*)
GMMJAX_OPERATOR(/)
GMMJAX_OPERATOR(&)
GMMJAX_OPERATOR(|)
#undef GMMJAX_OPERATOR

#define GMMJAX_COMPARISON(op)                                                            \
  template <typename T, int kBytes>                                                      \
  GMMJAX_INLINE Bits<T, kBytes> operator op(Vector<T, kBytes> a, Vector<T, kBytes> b) {  \
    if constexpr (kBytes == kMachineBytes)                                               \
      return {(typename Bits<T, kBytes>::Value)(a.value op b.value)};                    \
    else                                                                                 \
      return {a.low op b.low, a.high op b.high};                                         \
  }                                                                                      \
  template <typename T, int kBytes>                                                      \
  GMMJAX_INLINE Bits<T, kBytes> operator op(Vector<T, kBytes> a, Number<T> b) {          \
    return a op all<T, kBytes>(b);                                                       \
  }
GMMJAX_COMPARISON(<)
GMMJAX_COMPARISON(<=)
GMMJAX_COMPARISON(>)
#undef GMMJAX_COMPARISON

template <typename T, int kBytes>
GMMJAX_INLINE Vector<T, kBytes> operator~(Vector<T, kBytes> a) {
  if constexpr (kBytes == kMachineBytes)
    return {~a.value};
  else
    return {~a.low, ~a.high};
}

template <typename T, int kBytes>
GMMJAX_INLINE Vector<T, kBytes> operator<<(Vector<T, kBytes> a, int places) {
  if constexpr (kBytes == kMachineBytes)
    return {a.value << places};
  else
    return {a.low << places, a.high << places};
}

// The numbers of the first where the bits are 1, else those of the second.
template <typename T, int kBytes>
GMMJAX_INLINE Vector<T, kBytes> select(Bits<T, kBytes> which, Vector<T, kBytes> first, Vector<T, kBytes> second) {
  if constexpr (kBytes == kMachineBytes)
    return {which.value ? first.value : second.value};
  else
    return {select(which.low, first.low, second.low), select(which.high, first.high, second.high)};
}

template <typename To, typename From, int kBytes>
GMMJAX_INLINE Vector<To, kBytes> bits_as(Vector<From, kBytes> from) {
  if constexpr (kBytes == kMachineBytes)
    return {(typename Vector<To, kBytes>::Value)from.value};
  else
    return {bits_as<To>(from.low), bits_as<To>(from.high)};
}

// Integers that are not negative, shifted to the right: AVX2 has no such instruction for signed ones of 64 bits.
template <typename T, int kBytes>
GMMJAX_INLINE Vector<T, kBytes> shifted_right(Vector<T, kBytes> a, int places) {
  using Unsigned = std::make_unsigned_t<T>;
  if constexpr (kBytes == kMachineBytes) {
    typedef Unsigned Whole __attribute__((vector_size(kMachineBytes)));
    return {(typename Vector<T, kBytes>::Value)((Whole)a.value >> places)};
  } else {
    return {shifted_right(a.low, places), shifted_right(a.high, places)};
  }
}

// All bits that are 1 in some lane of 64 bits.
template <typename T, int kBytes>
GMMJAX_INLINE int64_t joined(Vector<T, kBytes> bits) {
  if constexpr (kBytes == kMachineBytes) {
    int64_t parts[kBytes / 8], any = 0;
    std::memcpy(parts, &bits.value, sizeof(parts));
    for (int64_t part : parts) any |= part;
    return any;
  } else {
    return joined(bits.low | bits.high);
  }
}

// The lanes where a comparison of doubles holds, each as one bit.
GMMJAX_INLINE unsigned lanes(Bits<double> which) {
  static constexpr int64_t kLane[] = {1, 2, 4, 8, 16, 32, 64, 128};
  return unsigned(joined(which & load(kLane)));
}

template <typename T, int kBytes>
GMMJAX_INLINE T lowest(Vector<T, kBytes> vector) {
  if constexpr (kBytes == kMachineBytes) {
    T least = vector[0];
    GMMJAX_UNROLL
    for (int lane = 1; lane < kBytes / int(sizeof(T)); ++lane) least = vector[lane] < least ? vector[lane] : least;
    return least;
  } else {
    return lowest(select(vector.low < vector.high, vector.low, vector.high));
  }
}

template <typename T>
GMMJAX_INLINE double sum(Vector<T> vector) {
  double total = 0;
  GMMJAX_UNROLL
  for (int lane = 0; lane < Lanes<T>::kCount; ++lane) total += vector[lane];
  return total;
}

// e^x for x <= 0, to the last digits: 2^n by the exponent's bits, e^r by its series, |r| <= log(2) / 2. The terms are
// added in pairs (Estrin's scheme), so that the chain of dependent operations is short.
template <typename T>
GMMJAX_INLINE Vector<T> exponential(Vector<T> x) {
  using L = Lanes<T>;
  using I = typename L::Integer;
  x = select(x < L::kLeast, all<T>(L::kLeast), x);
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
  const Bits<T> exponent = bits_as<I>(rounded) - bits_as<I>(all<T>(L::kRounding)) + L::kBias;
  return series * bits_as<T>(exponent << L::kMantissa);
}

// log(x) for x >= 1: the exponent, and the series of log((1 + s) / (1 - s)) of the mantissa.
template <typename T>
GMMJAX_INLINE Vector<T> logarithm(Vector<T> x) {
  using L = Lanes<T>;
  using I = typename L::Integer;
  const Bits<T> bits = bits_as<I>(x);
  Bits<T> exponent = shifted_right(bits - bits_as<I>(all<T>(T(1))), L::kMantissa);
  Vector<T> mantissa = bits_as<T>(bits - (exponent << L::kMantissa));
  const Bits<T> large = mantissa > T(1.41421356237309504880);
  mantissa = select(large, mantissa * T(0.5), mantissa);
  exponent = select(large, exponent + I(1), exponent);
  const Vector<T> s = (mantissa - T(1)) / (mantissa + T(1));
  const Vector<T> squared = s * s;
  Vector<T> series = all<T>(T(1.0 / (2 * L::kLogTerms + 1)));
  GMMJAX_UNROLL
  for (int term = L::kLogTerms - 1; term >= 0; --term) series = series * squared + T(1.0 / (2 * term + 1));
  // The whole number as a floating one: AVX2 has no such instruction for 64 bits.
  const Vector<T> power = bits_as<T>(exponent + bits_as<I>(all<T>(L::kRounding))) - L::kRounding;
  return power * L::kLog2High + (power * L::kLog2Low + T(2) * s * series);
}

}  // namespace
}  // namespace gmmjax::GMMJAX_INSTRUCTION_SET
