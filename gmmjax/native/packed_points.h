// The points of a cloud, packed so that those in a cylinder are found quickly.

#pragma once

#include <cstdint>
#include <vector>

#include "cylinders.h"

namespace gmmjax {

// A tree of boxes over points in Morton order: sixteen to a leaf, eight boxes to a node.
class PackedPoints {
 public:
  // Of points [count, 3], which must be finite; there is at least one.
  PackedPoints(const double* points, int64_t count);

  // Computes what is asked of these points, with this machine's vectors; tree, order and memory need not be given.
  void project(CylinderProblem problem) const;

 private:
  std::vector<double> leaves_;
  std::vector<std::vector<double>> levels_;
};

}  // namespace gmmjax
