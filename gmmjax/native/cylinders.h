// The points of a cloud in cylinders.

#pragma once

#include <cstdint>

namespace gmmjax {

// Points in a leaf of the tree, and boxes in a node.
constexpr int kLeaf = 16, kBoxes = 8;

// A tree of boxes over the points of a cloud.
struct BoxTree {
  const double* leaves;         // [leaves, 3, kLeaf]: the points; NaN beyond the last one
  const double* const* levels;  // [depth], from the leaves' boxes up, of [nodes, 6, kBoxes]: centres, half edges
  int depth;
};

// Memory for the projections of the points in one cylinder.
struct Projected {
  double* values;
  int64_t capacity;

  Projected();
  Projected(const Projected&) = delete;
  ~Projected();

  // Makes it hold so many at least; throws std::bad_alloc.
  void grow(int64_t capacity);
};

struct CylinderProblem {
  BoxTree tree;
  const double* centres;       // [count, 3]
  const double* axes;          // [count, 3]: unit vectors
  const double* radii;         // [count]
  const double* half_lengths;  // [count]
  int64_t* found;              // [count]: the number of points in each cylinder
  double* mean;                // [count]: of their projections to the axis, from the centre; NaN of none
  double* variance;            // [count]: of their projections; NaN of fewer than two
  int64_t count;
  const int64_t* order;  // [count]: in which they are taken; neighbours look up the same points, which are cached then
  Projected* projected;
};

#define GMMJAX_DECLARE(set)                         \
  namespace set {                                   \
  void projections(const CylinderProblem& problem); \
  }

GMMJAX_DECLARE(baseline)
#if defined(__x86_64__)
GMMJAX_DECLARE(avx2)
GMMJAX_DECLARE(avx512)
#endif
#undef GMMJAX_DECLARE

}  // namespace gmmjax
