#include "packed_points.h"

#include <algorithm>
#include <array>
#include <limits>
#include <new>
#include <utility>

#include "instructions.h"

namespace gmmjax {
namespace {

constexpr double kNothing = std::numeric_limits<double>::quiet_NaN();

struct Extent {
  std::array<double, 3> lower, upper;

  Extent() {
    lower.fill(std::numeric_limits<double>::infinity());
    upper.fill(-std::numeric_limits<double>::infinity());
  }

  void add(const double* low, const double* high) {
    for (int axis = 0; axis < 3; ++axis) {
      lower[axis] = std::min(lower[axis], low[axis]);
      upper[axis] = std::max(upper[axis], high[axis]);
    }
  }
};

// The lowest 21 bits with two zeros after each.
uint64_t spread(uint64_t bits) {
  bits = (bits | bits << 32) & 0x1f00000000ffffull;
  bits = (bits | bits << 16) & 0x1f0000ff0000ffull;
  bits = (bits | bits << 8) & 0x100f00f00f00f00full;
  bits = (bits | bits << 4) & 0x10c30c30c30c30c3ull;
  return (bits | bits << 2) & 0x1249249249249249ull;
}

using Coded = std::pair<uint64_t, int64_t>;

// Sorts by the first, and leaves equals in their order: digit by digit, the lowest first.
void sort(std::vector<Coded>& coded) {
  constexpr int kBits = 11, kDigits = 6;
  std::vector<Coded> sorted(coded.size());
  for (int digit = 0; digit < kDigits; ++digit) {
    const auto of = [digit](const Coded& one) { return one.first >> (digit * kBits) & ((1 << kBits) - 1); };
    std::array<size_t, (1 << kBits) + 1> first{};
    for (const Coded& one : coded) ++first[of(one) + 1];
    if (first[of(coded[0]) + 1] == coded.size()) continue;
    for (int value = 0; value < 1 << kBits; ++value) first[value + 1] += first[value];
    for (const Coded& one : coded) sorted[first[of(one)]++] = one;
    coded.swap(sorted);
  }
}

std::vector<Coded> morton_order(const double* points, int64_t count) {
  Extent extent;
  for (int64_t point = 0; point < count; ++point) extent.add(points + 3 * point, points + 3 * point);
  double edge = 0;
  for (int axis = 0; axis < 3; ++axis) edge = std::max(edge, extent.upper[axis] - extent.lower[axis]);
  constexpr double kCells = (1 << 21) - 1;
  const auto cell = [&](double coordinate, double lower) {
    const double place = (coordinate - lower) / edge * kCells;
    // The comparison is false for NaN, where all coordinates are equal.
    return place > 0 ? uint64_t(std::min(place, kCells)) : 0;
  };
  std::vector<Coded> coded(count);
  for (int64_t point = 0; point < count; ++point) {
    uint64_t code = 0;
    for (int axis = 0; axis < 3; ++axis) code |= spread(cell(points[3 * point + axis], extent.lower[axis])) << axis;
    coded[point] = {code, point};
  }
  sort(coded);
  return coded;
}

// The boxes in nodes. Where there is none, its half edges are minus infinity, and nothing touches it.
std::vector<double> nodes_of(const std::vector<Extent>& extents) {
  const size_t nodes = (extents.size() + kBoxes - 1) / kBoxes;
  std::vector<double> boxes(nodes * 6 * kBoxes);
  for (size_t box = 0; box < nodes * kBoxes; ++box) {
    double* into = &boxes[box / kBoxes * 6 * kBoxes + box % kBoxes];
    for (int axis = 0; axis < 3; ++axis, into += kBoxes) {
      double centre = 0, half = -std::numeric_limits<double>::infinity();
      if (box < extents.size()) {
        const double lower = extents[box].lower[axis], upper = extents[box].upper[axis];
        centre = lower + (upper - lower) / 2;
        half = std::max(centre - lower, upper - centre);
      }
      into[0] = centre;
      into[3 * kBoxes] = half;
    }
  }
  return boxes;
}

}  // namespace

PackedPoints::PackedPoints(const double* points, int64_t count) {
  const std::vector<Coded> order = morton_order(points, count);
  std::vector<Extent> extents((count + kLeaf - 1) / kLeaf);
  leaves_.assign(extents.size() * 3 * kLeaf, kNothing);
  for (int64_t place = 0; place < count; ++place) {
    const double* point = points + 3 * order[place].second;
    extents[place / kLeaf].add(point, point);
    double* into = &leaves_[place / kLeaf * 3 * kLeaf + place % kLeaf];
    for (int axis = 0; axis < 3; ++axis) into[axis * kLeaf] = point[axis];
  }
  levels_.push_back(nodes_of(extents));
  while (extents.size() > kBoxes) {
    std::vector<Extent> above((extents.size() + kBoxes - 1) / kBoxes);
    for (size_t box = 0; box < extents.size(); ++box)
      above[box / kBoxes].add(extents[box].lower.data(), extents[box].upper.data());
    extents.swap(above);
    levels_.push_back(nodes_of(extents));
  }
}

void PackedPoints::project(CylinderProblem problem) const {
  using Kernel = void (*)(const CylinderProblem&);
  static const Kernel kernel = GMMJAX_VERSION(Kernel, projections);
  std::vector<const double*> levels;
  for (const std::vector<double>& level : levels_) levels.push_back(level.data());
  std::vector<int64_t> order;
  if (problem.count > 0)
    for (const Coded& one : morton_order(problem.centres, problem.count)) order.push_back(one.second);
  Projected projected;
  problem.order = order.data();
  problem.tree = {leaves_.data(), levels.data(), int(levels.size())};
  problem.projected = &projected;
  kernel(problem);
}

Projected::Projected() : values(nullptr), capacity(0) {}

Projected::~Projected() { delete[] values; }

void Projected::grow(int64_t least) {
  double* const larger = new double[least];
  std::copy(values, values + capacity, larger);
  delete[] values;
  values = larger, capacity = least;
}

}  // namespace gmmjax
