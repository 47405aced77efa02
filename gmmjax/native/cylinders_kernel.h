// The points in cylinders, for one instruction set: eight boxes of the tree, or eight points, at a time.

#include <cstdint>
#include <limits>

#include "cylinders.h"

namespace gmmjax::GMMJAX_INSTRUCTION_SET {
namespace {

using Numbers = Vector<double>;
using Flags = Bits<double>;
static_assert(kBoxes == Lanes<double>::kCount && kLeaf % kBoxes == 0);
// A comparison of a vector's lanes that holds in all of them.
constexpr unsigned kAll = (1 << kBoxes) - 1;

inline Numbers absolute(Numbers values) {
  return bits_as<double>(bits_as<int64_t>(values) & std::numeric_limits<int64_t>::max());
}

class Search {
 public:
  Search(const BoxTree& tree, Projected& projected) : tree_(tree), projected_(projected) {}

  // Finds the projections of the points in a cylinder.
  void run(const double* centre, const double* axis, double radius, double half_length) {
    centre_ = centre, axis_ = axis, half_length_ = half_length, squared_radius_ = radius * radius;
    // What is left out by its box must be outside, whatever was rounded.
    const double slack = 1e-12 * (radius + half_length);
    extents_[0] = half_length + slack, extents_[1] = extents_[2] = radius + slack;
    turn();
    count_ = 0;
    visit(tree_.depth - 1, 0);
  }

  int64_t count() const { return count_; }

  // The mean of the projections, and the sum of the squared deviations from it.
  void moments(double& mean, double& squares) {
    Numbers totals{}, deviations{};
    const int64_t whole = filled_up(0);
    for (int64_t first = 0; first < whole; first += kBoxes) totals += load(projected_.values + first);
    mean = sum<double>(totals) / double(count_);
    filled_up(mean);
    for (int64_t first = 0; first < whole; first += kBoxes) {
      const Numbers deviation = load(projected_.values + first) - mean;
      deviations += deviation * deviation;
    }
    squares = sum<double>(deviations);
  }

 private:
  // Fills the projections up with a value to whole vectors, for which there is room behind the last leaf; their number.
  int64_t filled_up(double value) {
    const int64_t whole = (count_ + kBoxes - 1) / kBoxes * kBoxes;
    for (int64_t place = count_; place < whole; ++place) projected_.values[place] = value;
    return whole;
  }

  // Two directions at right angles to the axis and to each other: the cylinder lies in a box along the three.
  void turn() {
    const double x = axis_[0], y = axis_[1], z = axis_[2], sign = __builtin_copysign(1.0, z), scale = -1 / (sign + z);
    directions_[0] = {x, y, z};
    directions_[1] = {1 + sign * x * x * scale, sign * x * y * scale, -sign * x};
    directions_[2] = {x * y * scale, sign + y * y * scale, -y};
  }

  // The boxes of a node that the cylinder may touch, as bits: those that no direction separates from it.
  unsigned touched(const double* boxes) const {
    Numbers offsets[3], halves[3];
    for (int axis = 0; axis < 3; ++axis) {
      offsets[axis] = load(boxes + axis * kBoxes) - centre_[axis];
      halves[axis] = load(boxes + (3 + axis) * kBoxes);
    }
    Flags touched = all<int64_t>(-1);
    for (int direction = 0; direction < 3; ++direction) {
      const auto [x, y, z] = directions_[direction];
      const Numbers along = x * offsets[0] + y * offsets[1] + z * offsets[2];
      const Numbers reach =
          __builtin_fabs(x) * halves[0] + __builtin_fabs(y) * halves[1] + __builtin_fabs(z) * halves[2];
      touched &= absolute(along) <= reach + extents_[direction];
    }
    return lanes(touched);
  }

  void visit(int level, int64_t node) {
    for (unsigned inside = touched(tree_.levels[level] + node * 6 * kBoxes); inside != 0; inside &= inside - 1) {
      const int box = __builtin_ctz(inside);
      if (level == 0)
        collect(tree_.leaves + (node * kBoxes + box) * 3 * kLeaf);
      else
        visit(level - 1, node * kBoxes + box);
    }
  }

  // Appends the projections of those points of a leaf that are in the cylinder.
  void collect(const double* leaf) {
    if (projected_.capacity < count_ + kLeaf + kBoxes) projected_.grow(2 * projected_.capacity + kLeaf + kBoxes);
    double* into = projected_.values + count_;
    for (int first = 0; first < kLeaf; first += kBoxes) {
      const Numbers x = load(leaf + first) - centre_[0], y = load(leaf + kLeaf + first) - centre_[1],
                    z = load(leaf + 2 * kLeaf + first) - centre_[2];
      const Numbers along = x * axis_[0] + y * axis_[1] + z * axis_[2];
      const Numbers dx = x - along * axis_[0], dy = y - along * axis_[1], dz = z - along * axis_[2];
      const unsigned inside =
          lanes((absolute(along) <= half_length_) & (dx * dx + dy * dy + dz * dz <= squared_radius_));
      if (inside == kAll) {
        store(into, along);
        into += kBoxes;
      } else if (inside != 0) {
        double values[kBoxes];
        store(values, along);
        for (int lane = 0; lane < kBoxes; ++lane) {
          *into = values[lane];
          into += inside >> lane & 1;
        }
      }
    }
    count_ = into - projected_.values;
  }

  struct Direction {
    double x, y, z;
  };

  const BoxTree tree_;
  Projected& projected_;
  const double* centre_ = nullptr;
  const double* axis_ = nullptr;
  double half_length_ = 0, squared_radius_ = 0;
  Direction directions_[3];
  double extents_[3];
  int64_t count_ = 0;
};

}  // namespace

void projections(const CylinderProblem& problem) {
  constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();
  Search search(problem.tree, *problem.projected);
  for (int64_t place = 0; place < problem.count; ++place) {
    const int64_t index = problem.order[place];
    search.run(problem.centres + 3 * index, problem.axes + 3 * index, problem.radii[index], problem.half_lengths[index]);
    const int64_t found = problem.found[index] = search.count();
    double mean = kUnknown, squares = kUnknown;
    if (found > 0) search.moments(mean, squares);
    problem.mean[index] = mean;
    problem.variance[index] = found > 1 ? squares / double(found - 1) : kUnknown;
  }
}

}  // namespace gmmjax::GMMJAX_INSTRUCTION_SET
