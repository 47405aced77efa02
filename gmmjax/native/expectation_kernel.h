// The E-step's sums over the points, for one instruction set: included by a translation unit for each.
//
// A block of points stays in the first-level cache, with the log joints of all components.

#include <cstdint>
#include <cstring>

#include "expectation.h"

namespace gmmjax::GMMJAX_INSTRUCTION_SET {
namespace {

// Vectors of a block: their chains of dependent operations run side by side.
constexpr int kVectors = 8;
template <typename T>
constexpr int kBlock = kVectors * Lanes<T>::kCount;
// Of these as many at a time as half of the machine's registers hold: 16 of AVX-512, 8 of narrower ones.
constexpr int kHeld = kVectors * kMachineBytes / kVectorBytes;
// And the same for two components at once, where AVX-512 has registers to spare.
constexpr int kTogether = kMachineBytes < kVectorBytes ? kHeld / 2 : kHeld;
static_assert(kTogether > 0);

// Chunks of points after which the lanes' sums are added up in double precision.
template <typename T>
constexpr int kFlush = sizeof(T) == 4 ? 4 : 1 << 30;
// A component with less than e to this of the likeliest one's density at every point of a block adds nothing.
template <typename T>
constexpr T kNegligible = sizeof(T) == 4 ? -20 : -40;

// The log joints of some components at the points of a block: linear functions of their features.
template <typename T, int kRows>
inline void log_joints(const T* const* parameters, int features, const T* block, int64_t stride, T* joint) {
  for (int first = 0; first < kVectors; first += kTogether) {
    Vector<T> values[kRows][kTogether] = {};
    const T* own = block + first * Lanes<T>::kCount;
    for (int f = 0; f < features; ++f) {
      GMMJAX_UNROLL
      for (int v = 0; v < kTogether; ++v) {
        const Vector<T> feature = load<T>(own + f * stride + v * Lanes<T>::kCount);
        for (int row = 0; row < kRows; ++row) values[row][v] += parameters[row][f] * feature;
      }
    }
    for (int row = 0; row < kRows; ++row)
      for (int v = 0; v < kTogether; ++v)
        store(joint + row * kBlock<T> + (first + v) * Lanes<T>::kCount, values[row][v]);
  }
}

// Whether the values are negligible at every point of a block; false where they are not numbers.
template <typename T>
inline bool negligible(const Vector<T>* values) {
  Bits<T> not_small = ~(values[0] < kNegligible<T>);
  for (int v = 1; v < kVectors; ++v) not_small |= ~(values[v] < kNegligible<T>);
  return joined(not_small) == 0;
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
      if (chunk % kFlush<T> == kFlush<T> - 1) flush();
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
        highest[v] = select(own > highest[v], own, highest[v]);
      }
    Vector<T> density[kVectors] = {};
    int present = 0;
    for (int m = 0; m < live_count_; ++m) {
      for (int v = 0; v < kVectors; ++v) values[v] = load<T>(joint(m) + v * kCount) - highest[v];
      if (negligible<T>(values)) continue;
      for (int v = 0; v < kVectors; ++v) {
        values[v] = exponential<T>(values[v]);
        density[v] += values[v];
        store(joint(present) + v * kCount, values[v]);
      }
      p_.workspace.present[present++] = m;
    }
    if (p_.tangents != nullptr) differentiate(present, density, features, stride);
    Vector<T> log_likelihood{};
    for (int v = 0; v < kVectors; ++v) {
      const Vector<T> own = load<T>(mass + v * kCount);
      log_likelihood += own * (highest[v] + logarithm<T>(density[v]));
      density[v] = own / density[v];
    }
    for (int i = 0; i < present; ++i) add_sums(p_.workspace.present[i], joint(i), density, features, stride);
    return log_likelihood;
  }

  // Joint densities times what their log joints' tangents differ by from their mean over the components.
  void differentiate(int present, const Vector<T>* density, const T* features, int64_t stride) {
    constexpr int kCount = Lanes<T>::kCount;
    for (int i = 0; i < present; i += 2) {
      const T* rows[] = {tangents(i), tangents(i + 1 < present ? i + 1 : i)};
      log_joints<T, 2>(rows, p_.features, features, stride, tangent(i));
    }
    for (int v = 0; v < kVectors; ++v) {
      Vector<T> mean{};
      for (int i = 0; i < present; ++i) mean += load<T>(joint(i) + v * kCount) * load<T>(tangent(i) + v * kCount);
      mean = mean / density[v];
      for (int i = 0; i < present; ++i) {
        T* own = joint(i) + v * kCount;
        store(own, load<T>(own) * (load<T>(tangent(i) + v * kCount) - mean));
      }
    }
  }

  // One component's responsibilities, times the features of the block.
  void add_sums(int m, const T* joint, const Vector<T>* share, const T* features, int64_t stride) {
    constexpr int kCount = Lanes<T>::kCount;
    T* own = p_.workspace.sums + int64_t(m) * p_.features * kCount;
    for (int first = 0; first < kVectors; first += kHeld) {
      Vector<T> responsibilities[kHeld];
      GMMJAX_UNROLL
      for (int v = 0; v < kHeld; ++v) responsibilities[v] = load<T>(joint + (first + v) * kCount) * share[first + v];
      for (int f = 0; f < p_.features; ++f) {
        const T* of_block = features + f * stride + first * kCount;
        Vector<T> total = load<T>(own + f * kCount);
        GMMJAX_UNROLL
        for (int v = 0; v < kHeld; ++v) total += responsibilities[v] * load<T>(of_block + v * kCount);
        store(own + f * kCount, total);
      }
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

  // Of the i-th component that is present in the block.
  const T* tangents(int i) const { return p_.tangents + int64_t(live_[p_.workspace.present[i]]) * p_.features; }

  T* joint(int m) { return p_.workspace.joint + int64_t(m) * kBlock<T>; }

  T* tangent(int i) { return p_.workspace.tangents + int64_t(i) * kBlock<T>; }

  const ExpectationProblem<T>& p_;
  int* live_;
  int live_count_;
};

}  // namespace

void add_up(const ExpectationProblem<double>& problem) { Expectation<double>(problem).run(); }
void add_up(const ExpectationProblem<float>& problem) { Expectation<float>(problem).run(); }

}  // namespace gmmjax::GMMJAX_INSTRUCTION_SET
