// Balanced transport between few components, exactly.

#pragma once

#include <cstdint>

namespace gmmjax {

// All in double precision. Of the arrays for live rows and columns alone, rows of a matrix are `width` apart.
struct TransportWorkspace {
  int* rows;             // [rows]: which are live
  int* columns;          // [columns]
  int* from_column;      // [rows]: by which the search came to a row
  int64_t* from_row;     // [width]
  uint64_t* carriers;    // [columns, words]: the rows that send mass to a column, as bits
  uint64_t* reached;     // [words]: the rows that the search has reached
  double* cost;          // [rows, width]
  double* flow;          // [rows, width]
  double* price;         // [width]
  double* open_price;    // [width]: the price where the search may still go, else minus infinity
  double* distance;      // [width]: from the search's root, where it may still go, else infinity
  double* last_distance; // [width]: where the search has been
  double* row_distance;  // [rows]
  double* row_price;     // [rows]
  double* supply;        // [rows]: what is left of it
  double* demand;        // [columns]
};

// Doubles in a vector of 64 bytes, and rows in a word of bits.
constexpr int kTransportLanes = 8, kWord = 64;

template <typename T>
struct TransportProblem {
  const T* supply;  // [rows]
  const T* demand;  // [columns]
  const T* cost;    // [rows, columns]
  const T* start;   // [columns]: prices to start from, or infinity
  T* plan;          // [rows, columns]
  T* row_potentials;
  T* column_potentials;
  bool* optimal;
  int32_t* augmentations;
  int32_t most_augmentations;
  int rows, columns, width, words;
  TransportWorkspace workspace;
};

// Masses of any totals, in arrays of the host.
struct ExactProblem {
  const double* before;  // [rows]
  const double* after;   // [columns]
  const double* cost;    // [rows, columns]
  const double* start;   // [columns]: potentials of the after side to start from, or null
  double* plan;          // [rows, columns]
  double* of_before;     // [2, rows]: the potentials, and the unmatched mass
  double* of_after;      // [2, columns]: the same
  int rows, columns;
  int32_t most_augmentations;
};

struct ExactCost {
  double cost;
  const char* status;  // the name of a `TransportStatus`
};

// What `gmmjax/transport/exact.py` and `embedding.py` do around the kernel, with the same conventions.
ExactCost exact_transport(const ExactProblem& problem);

#define GMMJAX_DECLARE(set)                                \
  namespace set {                                          \
  void transport(const TransportProblem<double>& problem); \
  void transport(const TransportProblem<float>& problem);  \
  }

GMMJAX_DECLARE(baseline)
#if defined(__x86_64__)
GMMJAX_DECLARE(avx2)
GMMJAX_DECLARE(avx512)
#endif
#undef GMMJAX_DECLARE

}  // namespace gmmjax
