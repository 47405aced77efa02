// The E-step of a mixture whose log joints are linear in the features of a point, equation (2.6).

#pragma once

#include <cstdint>

namespace gmmjax {

// A row of parameters that begins with less is of a dead component: it gets nothing, and costs nothing.
constexpr double kDead = -1e29;

// The widest block of points and the most lanes, of any precision.
constexpr int kMostBlock = 128, kMostLanes = 16;

template <typename T>
struct ExpectationWorkspace {
  int* live;       // [rows]
  int* present;    // [rows]
  double* totals;  // [rows, features]
  T* sums;         // [rows, features, lanes]
  T* joint;        // [rows + 1, block]
  T* tangents;     // [rows + 1, block]; unused without tangents
  T* padded;       // [features + 1, block]
};

template <typename T>
struct ExpectationProblem {
  const T* parameters;  // [rows, features]
  const T* tangents;    // [rows, features]: of the parameters, for those of the sums; null for the sums themselves
  const T* points;      // [chunks, features, chunk_size]
  const T* mass;        // [chunks, chunk_size]
  T* sums;              // [rows, features]
  T* log_likelihood;    // [1]
  int rows, features;
  int64_t chunks, chunk_size;
  ExpectationWorkspace<T> workspace;
};

#define GMMJAX_DECLARE(set)                                    \
  namespace set {                                              \
  void add_up(const ExpectationProblem<double>& problem);      \
  void add_up(const ExpectationProblem<float>& problem);       \
  }

GMMJAX_DECLARE(baseline)
#if defined(__x86_64__)
GMMJAX_DECLARE(avx2)
GMMJAX_DECLARE(avx512)
#endif
#undef GMMJAX_DECLARE

}  // namespace gmmjax
