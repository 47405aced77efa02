// The E-step's sums over the points, for one instruction set: included by a translation unit for each.
//
// A block of points stays in the first-level cache, with the log joints of all components. Vectors are 64 bytes wide;
// where the machine's are narrower, the compiler splits them.

#include <cstdint>
#include <cstring>

#include "expectation.h"

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
  // Chunks of points after which the lanes' sums are added up.
  static constexpr int kFlush = 1 << 30;
  // Adding it rounds to an integer, which then stands in the lowest bits.
  static constexpr double kRounding = 0x1.8p52;
  static constexpr int kMantissa = 52;
  static constexpr int64_t kBias = 1023;
  static constexpr double kLeast = -708;
  // A component with less than e^kNegligible of the likeliest one's density at every point of a block adds nothing.
  static constexpr double kNegligible = -40;
  static constexpr double kLog2High = 0x1.62e42fee00000p-1, kLog2Low = 0x1.a39ef35793c76p-33;
  static constexpr int kExpTerms = 12, kLogTerms = 11;
};

template <>
struct Lanes<float> {
  typedef float Vector __attribute__((vector_size(64)));
  typedef int32_t Bits __attribute__((vector_size(64)));
  static constexpr int kCount = 16;
  static constexpr int kFlush = 4;
  static constexpr float kRounding = 0x1.8p23f;
  static constexpr int kMantissa = 23;
  static constexpr int32_t kBias = 127;
  static constexpr float kLeast = -87;
  static constexpr float kNegligible = -20;
  static constexpr float kLog2High = 0x1.62e4p-1f, kLog2Low = 0x1.7f7d1cp-20f;
  static constexpr int kExpTerms = 7, kLogTerms = 5;
};

template <typename T>
using Vector = typename Lanes<T>::Vector;

// Vectors of a block: their chains of dependent operations run side by side.
constexpr int kVectors = 8;
template <typename T>
constexpr int kBlock = kVectors * Lanes<T>::kCount;

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

// e^x for x <= 0, to the last digits: 2^n by the exponent's bits, e^r by its series, |r| <= log(2) / 2.
template <typename T>
inline Vector<T> exponential(Vector<T> x) {
  using L = Lanes<T>;
  using Bits = typename L::Bits;
  x = x < L::kLeast ? all<T>(L::kLeast) : x;
  const Vector<T> rounded = x * T(1.44269504088896340736) + L::kRounding;
  const Vector<T> whole = rounded - L::kRounding;
  const Vector<T> rest = (x - whole * L::kLog2High) - whole * L::kLog2Low;
  Vector<T> series;
  const Vector<T> r2 = rest * rest, r4 = r2 * r2;
  const Vector<T> low = (T(1) + rest) + (T(1.0 / 2) + T(1.0 / 6) * rest) * r2;
  const Vector<T> middle = (T(1.0 / 24) + T(1.0 / 120) * rest) + (T(1.0 / 720) + T(1.0 / 5040) * rest) * r2;
  if constexpr (sizeof(T) == 4) {
    series = low + middle * r4;
  } else {
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

// The log joints of some components at the points of a block: linear functions of their features.
template <typename T, int kRows>
inline void log_joints(const T* const* parameters, int features, const T* block, int64_t stride, T* joint) {
  Vector<T> values[kRows][kVectors] = {};
  for (int f = 0; f < features; ++f)
    for (int v = 0; v < kVectors; ++v) {
      const Vector<T> feature = load<T>(block + f * stride + v * Lanes<T>::kCount);
      for (int row = 0; row < kRows; ++row) values[row][v] += parameters[row][f] * feature;
    }
  for (int row = 0; row < kRows; ++row)
    for (int v = 0; v < kVectors; ++v) store<T>(joint + row * kBlock<T> + v * Lanes<T>::kCount, values[row][v]);
}

// Whether the values are negligible at every point of a block; false where they are not numbers.
template <typename T>
inline bool negligible(const Vector<T>* values) {
  auto not_small = ~(values[0] < Lanes<T>::kNegligible);
  for (int v = 1; v < kVectors; ++v) not_small |= ~(values[v] < Lanes<T>::kNegligible);
  int64_t parts[8], any = 0;
  std::memcpy(parts, &not_small, sizeof(parts));
  for (int64_t part : parts) any |= part;
  return any == 0;
}

template <typename T>
class Expectation {
 public:
  explicit Expectation(const ExpectationProblem<T>& problem) : p_(problem), live_(problem.workspace.live) {
    live_count_ = 0;
    for (int row = 0; row < p_.rows; ++row)
      if (!(p_.parameters[row * p_.features] <= T(kDead))) live_[live_count_++] = row;
    if (live_count_ == 0)
      for (; live_count_ < p_.rows; ++live_count_) live_[live_count_] = live_count_;
    for (int i = 0; i < p_.rows * p_.features; ++i) p_.workspace.totals[i] = 0;
    clear();
  }

  void run() {
    double log_likelihood = 0;
    for (int64_t chunk = 0; chunk < p_.chunks; ++chunk) {
      log_likelihood += sum<T>(add_chunk(chunk));
      if (chunk % Lanes<T>::kFlush == Lanes<T>::kFlush - 1) flush();
    }
    flush();
    for (int i = 0; i < p_.rows * p_.features; ++i) p_.sums[i] = T(p_.workspace.totals[i]);
    *p_.log_likelihood = T(log_likelihood);
  }

 private:
  Vector<T> add_chunk(int64_t chunk) {
    const T* features = p_.points + chunk * p_.features * p_.chunk_size;
    const T* mass = p_.mass + chunk * p_.chunk_size;
    Vector<T> log_likelihood{};
    int64_t start = 0;
    for (; start + kBlock<T> <= p_.chunk_size; start += kBlock<T>)
      log_likelihood += add_block(features + start, p_.chunk_size, mass + start);
    if (start < p_.chunk_size) log_likelihood += add_rest(features + start, mass + start, p_.chunk_size - start);
    return log_likelihood;
  }

  // The last points of a chunk, filled up with points of mass 0 at the origin.
  Vector<T> add_rest(const T* features, const T* mass, int64_t count) {
    T* padded = p_.workspace.padded;
    std::memset(padded, 0, (p_.features + 1) * kBlock<T> * sizeof(T));
    for (int f = 0; f < p_.features; ++f)
      std::memcpy(padded + f * kBlock<T>, features + f * p_.chunk_size, count * sizeof(T));
    T* padded_mass = padded + p_.features * kBlock<T>;
    std::memcpy(padded_mass, mass, count * sizeof(T));
    return add_block(padded, kBlock<T>, padded_mass);
  }

  // Adds what a block gives to every component; the log likelihoods of its points, by lanes.
  Vector<T> add_block(const T* features, int64_t stride, const T* mass) {
    constexpr int kCount = Lanes<T>::kCount;
    Vector<T> highest[kVectors], values[kVectors];
    for (int m = 0; m < live_count_; m += 2) {
      const T* rows[] = {parameters(m), parameters(m + 1 < live_count_ ? m + 1 : m)};
      log_joints<T, 2>(rows, p_.features, features, stride, joint(m));
    }
    for (int v = 0; v < kVectors; ++v) highest[v] = load<T>(joint(0) + v * kCount);
    for (int m = 1; m < live_count_; ++m)
      for (int v = 0; v < kVectors; ++v) {
        const Vector<T> own = load<T>(joint(m) + v * kCount);
        highest[v] = own > highest[v] ? own : highest[v];
      }
    Vector<T> density[kVectors] = {};
    int present = 0;
    for (int m = 0; m < live_count_; ++m) {
      for (int v = 0; v < kVectors; ++v) values[v] = load<T>(joint(m) + v * kCount) - highest[v];
      if (negligible<T>(values)) continue;
      for (int v = 0; v < kVectors; ++v) {
        values[v] = exponential<T>(values[v]);
        density[v] += values[v];
        store<T>(joint(present) + v * kCount, values[v]);
      }
      p_.workspace.present[present++] = m;
    }
    Vector<T> log_likelihood{};
    for (int v = 0; v < kVectors; ++v) {
      const Vector<T> own = load<T>(mass + v * kCount);
      log_likelihood += own * (highest[v] + logarithm<T>(density[v]));
      density[v] = own / density[v];
    }
    for (int i = 0; i < present; ++i) add_sums(p_.workspace.present[i], joint(i), density, features, stride);
    return log_likelihood;
  }

  // One component's responsibilities, times the features of the block.
  void add_sums(int m, const T* joint, const Vector<T>* share, const T* features, int64_t stride) {
    constexpr int kCount = Lanes<T>::kCount;
    Vector<T> responsibilities[kVectors];
    for (int v = 0; v < kVectors; ++v) responsibilities[v] = load<T>(joint + v * kCount) * share[v];
    T* own = p_.workspace.sums + int64_t(m) * p_.features * kCount;
    for (int f = 0; f < p_.features; ++f) {
      Vector<T> total = load<T>(own + f * kCount);
      for (int v = 0; v < kVectors; ++v) total += responsibilities[v] * load<T>(features + f * stride + v * kCount);
      store<T>(own + f * kCount, total);
    }
  }

  // Adds up the lanes in double precision.
  void flush() {
    for (int m = 0; m < live_count_; ++m)
      for (int f = 0; f < p_.features; ++f)
        p_.workspace.totals[live_[m] * p_.features + f] +=
            sum<T>(load<T>(p_.workspace.sums + (int64_t(m) * p_.features + f) * Lanes<T>::kCount));
    clear();
  }

  void clear() {
    std::memset(p_.workspace.sums, 0, sizeof(T) * live_count_ * p_.features * Lanes<T>::kCount);
  }

  const T* parameters(int m) const { return p_.parameters + int64_t(live_[m]) * p_.features; }

  T* joint(int m) { return p_.workspace.joint + int64_t(m) * kBlock<T>; }

  const ExpectationProblem<T>& p_;
  int* live_;
  int live_count_;
};

}  // namespace

void add_up(const ExpectationProblem<double>& problem) { Expectation<double>(problem).run(); }
void add_up(const ExpectationProblem<float>& problem) { Expectation<float>(problem).run(); }

}  // namespace gmmjax::GMMJAX_INSTRUCTION_SET
