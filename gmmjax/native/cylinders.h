// The points of a cloud in cylinders: a tree of boxes over points in Morton order, and what is asked of it.

#pragma once

#include <cstdint>
#include <vector>

namespace gmmjax {

// Points in a leaf of the tree, and boxes in a node.
constexpr int kLeaf = 16, kBoxes = 8;

struct PackedPoints {
  // Builds the tree of points [count, 3], which must be finite; there is at least one.
  PackedPoints(const double* points, int64_t count);

  std::vector<double> leaves;               // [leaves, 3, kLeaf]; NaN beyond the last point
  std::vector<std::vector<double>> levels;  // from the leaves' boxes up [nodes, 6, kBoxes]: centres, half edges
};

struct CylinderProblem {
  const PackedPoints* points;
  const double* centres;       // [count, 3]
  const double* axes;          // [count, 3]: unit vectors
  const double* radii;         // [count]
  const double* half_lengths;  // [count]
  int64_t* found;              // [count]: the number of points in each cylinder
  double* mean;                // [count]: of their projections to the axis, from the centre; NaN of none
  double* variance;            // [count]: of their projections; NaN of fewer than two
  int64_t count;
};

#define GMMJAX_DECLARE(set) \
  namespace set {           \
  void projections(const CylinderProblem& problem); \
  }

GMMJAX_DECLARE(baseline)
#if defined(__x86_64__)
GMMJAX_DECLARE(avx2)
GMMJAX_DECLARE(avx512)
#endif
#undef GMMJAX_DECLARE

// Computes it with this machine's vectors.
void project(const CylinderProblem& problem);

}  // namespace gmmjax
