// `gmmjax_transport` for XLA: the axes that `vmap` added, and the memory of one problem for all. And exact transport of
// arrays of the host.

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <utility>
#include <vector>

#include "handlers.h"

#include "instructions.h"
#include "transport.h"

namespace gmmjax {
namespace {

namespace ffi = xla::ffi;

template <typename T>
using Kernel = void (*)(const TransportProblem<T>&);

int width_of(int columns) { return (columns + kTransportLanes - 1) / kTransportLanes * kTransportLanes; }

int words_of(int rows) { return (rows + kWord - 1) / kWord; }

// Memory for problems of one shape.
class Memory {
 public:
  template <typename T>
  explicit Memory(TransportProblem<T>& problem)
      : Memory(problem.rows, problem.columns, width_of(problem.columns), words_of(problem.rows)) {
    problem.width = width_of(problem.columns), problem.words = words_of(problem.rows);
    problem.workspace = workspace;
  }

 private:
  Memory(int rows, int columns, int width, int words)
      : integers_(2 * size_t(rows) + columns),
        sources_(width),
        bits_(size_t(columns + 1) * words),
        doubles_(2 * size_t(rows) * width + 4 * width + 3 * rows + columns) {
    int* integers = integers_.data();
    uint64_t* bits = bits_.data();
    double* doubles = doubles_.data();
    const auto take = [](auto*& memory, size_t size) { return std::exchange(memory, memory + size); };
    workspace.rows = take(integers, rows);
    workspace.columns = take(integers, columns);
    workspace.from_column = take(integers, rows);
    workspace.from_row = sources_.data();
    workspace.carriers = take(bits, size_t(columns) * words);
    workspace.reached = take(bits, words);
    for (double** matrix : {&workspace.cost, &workspace.flow}) *matrix = take(doubles, size_t(rows) * width);
    for (double** vector : {&workspace.price, &workspace.open_price, &workspace.distance, &workspace.last_distance})
      *vector = take(doubles, width);
    for (double** vector : {&workspace.row_distance, &workspace.row_price, &workspace.supply})
      *vector = take(doubles, rows);
    workspace.demand = take(doubles, columns);
  }

  TransportWorkspace workspace;
  std::vector<int> integers_;
  std::vector<int64_t> sources_;
  std::vector<uint64_t> bits_;
  std::vector<double> doubles_;
};

template <typename T>
ffi::Error transport_all(ffi::AnyBuffer supply, ffi::AnyBuffer demand, ffi::AnyBuffer cost, ffi::AnyBuffer start,
                         ffi::Buffer<ffi::S32> most, ffi::Result<ffi::AnyBuffer> plan,
                         ffi::Result<ffi::AnyBuffer> row_potentials, ffi::Result<ffi::AnyBuffer> column_potentials,
                         ffi::Result<ffi::Buffer<ffi::PRED>> optimal, ffi::Result<ffi::Buffer<ffi::S32>> steps) {
  static const Kernel<T> kernel = GMMJAX_VERSION(Kernel<T>, transport);
  const auto shape = cost.dimensions();
  const size_t axes = shape.size() - 2;
  TransportProblem<T> problem;
  problem.rows = int(shape[axes]), problem.columns = int(shape[axes + 1]);
  const Memory memory(problem);

  const Axes of_supply(supply.dimensions(), axes), of_demand(demand.dimensions(), axes), of_cost(shape, axes),
      of_start(start.dimensions(), axes),
      of_most(most.dimensions(), axes);
  const auto stack = optimal->dimensions();
  const int64_t count = product(stack, 0, axes);
  for (int64_t index = 0; index < count; ++index) {
    problem.supply = supply.typed_data<T>() + of_supply.offset(stack, index);
    problem.demand = demand.typed_data<T>() + of_demand.offset(stack, index);
    problem.cost = cost.typed_data<T>() + of_cost.offset(stack, index);
    problem.start = start.typed_data<T>() + of_start.offset(stack, index);
    problem.most_augmentations = most.typed_data()[of_most.offset(stack, index)];
    problem.plan = plan->typed_data<T>() + index * problem.rows * problem.columns;
    problem.row_potentials = row_potentials->typed_data<T>() + index * problem.rows;
    problem.column_potentials = column_potentials->typed_data<T>() + index * problem.columns;
    problem.optimal = optimal->typed_data() + index;
    problem.augmentations = steps->typed_data() + index;
    kernel(problem);
  }
  return ffi::Error::Success();
}

ffi::Error transport(ffi::AnyBuffer supply, ffi::AnyBuffer demand, ffi::AnyBuffer cost, ffi::AnyBuffer start, ffi::Buffer<ffi::S32> most,
                     ffi::Result<ffi::AnyBuffer> plan, ffi::Result<ffi::AnyBuffer> row_potentials,
                     ffi::Result<ffi::AnyBuffer> column_potentials, ffi::Result<ffi::Buffer<ffi::PRED>> optimal,
                     ffi::Result<ffi::Buffer<ffi::S32>> steps) {
  switch (cost.element_type()) {
    case ffi::F64:
      return transport_all<double>(supply, demand, cost, start, most, plan, row_potentials, column_potentials, optimal, steps);
    case ffi::F32:
      return transport_all<float>(supply, demand, cost, start, most, plan, row_potentials, column_potentials, optimal, steps);
    default:
      return ffi::Error::InvalidArgument("gmmjax_transport computes in float32 and float64");
  }
}

double sum(const double* numbers, int64_t count) { return std::accumulate(numbers, numbers + count, 0.0); }

bool all_finite(const double* numbers, int64_t count) {
  return std::all_of(numbers, numbers + count, [](double number) { return std::isfinite(number); });
}

bool are_masses(const double* numbers, int64_t count) {
  return std::isfinite(sum(numbers, count)) &&
         std::all_of(numbers, numbers + count, [](double number) { return number >= 0; });
}

// One side of a balanced problem: the last component absorbs the surplus of the other side.
struct Side {
  // No component counts for more than `most`.
  Side(const double* given, int size, double most) : mass(size + 1), potentials(size + 1) {
    std::transform(given, given + size, mass.begin(), [most](double own) { return std::min(own, most); });
    total = sum(mass.data(), size);
  }

  double work() const { return std::inner_product(mass.begin(), mass.end(), potentials.begin(), 0.0); }

  std::vector<double> mass, potentials;
  double total;
};

}  // namespace

ExactCost exact_transport(const ExactProblem& p) {
  static const Kernel<double> kernel = GMMJAX_VERSION(Kernel<double>, transport);
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  const int rows = p.rows, columns = p.columns;
  const bool usable = are_masses(p.before, rows) && are_masses(p.after, columns) &&
                      all_finite(p.cost, int64_t(rows) * columns);
  const double flow = usable ? std::min(sum(p.before, rows), sum(p.after, columns)) : 0;
  if (flow == 0) {
    std::fill_n(p.plan, int64_t(rows) * columns, 0.0);
    std::fill_n(p.of_before, 2 * rows, 0.0), std::fill_n(p.of_after, 2 * columns, 0.0);
    if (usable) std::copy_n(p.before, rows, p.of_before + rows), std::copy_n(p.after, columns, p.of_after + columns);
    return {kInfinity, usable ? "no_mass" : "invalid_input"};
  }

  Side before(p.before, rows, 2 * flow), after(p.after, columns, 2 * flow);
  const double surplus = before.total - after.total;
  const double rounding = 16 * std::numeric_limits<double>::epsilon() * std::max(before.total, after.total);
  if (std::abs(surplus) > rounding) (surplus < 0 ? before : after).mass.back() = std::abs(surplus);
  std::vector<double> cost(size_t(rows + 1) * (columns + 1)), plan(cost.size()), start(columns + 1, kInfinity);
  for (int i = 0; i < rows; ++i)
    std::copy_n(p.cost + int64_t(i) * columns, columns, &cost[size_t(i) * (columns + 1)]);
  if (p.start != nullptr && all_finite(p.start, columns)) *std::copy_n(p.start, columns, start.begin()) = 0;

  bool optimal;
  int32_t augmentations;
  TransportProblem<double> problem;
  problem.supply = before.mass.data(), problem.demand = after.mass.data();
  problem.cost = cost.data(), problem.start = start.data(), problem.plan = plan.data();
  problem.row_potentials = before.potentials.data(), problem.column_potentials = after.potentials.data();
  problem.optimal = &optimal, problem.augmentations = &augmentations;
  problem.most_augmentations = p.most_augmentations;
  problem.rows = rows + 1, problem.columns = columns + 1;
  const Memory memory(problem);
  kernel(problem);

  const double total = sum(before.mass.data(), rows + 1) + sum(after.mass.data(), columns + 1);
  const double even = (after.work() - before.work()) / total;
  const double shift = before.mass.back() > 0   ? -before.potentials.back()
                       : after.mass.back() > 0 ? after.potentials.back()
                                               : even;
  double work = 0;
  for (int i = 0; i < rows; ++i) {
    const double* row = &plan[size_t(i) * (columns + 1)];
    std::copy_n(row, columns, p.plan + int64_t(i) * columns);
    work = std::inner_product(row, row + columns, p.cost + int64_t(i) * columns, work);
    p.of_before[i] = before.potentials[i] + shift;
    p.of_before[rows + i] = p.before[i] - before.mass[i] + row[columns];
  }
  for (int j = 0; j < columns; ++j) {
    p.of_after[j] = after.potentials[j] - shift;
    p.of_after[columns + j] = p.after[j] - after.mass[j] + plan[size_t(rows) * (columns + 1) + j];
  }
  if (!optimal) return {std::numeric_limits<double>::quiet_NaN(), "pivot_limit"};
  return {work / flow, "optimal"};
}

XLA_FFI_DEFINE_HANDLER_SYMBOL(BalancedTransport, transport,
                              ffi::Ffi::Bind()
                                  .Arg<ffi::AnyBuffer>()
                                  .Arg<ffi::AnyBuffer>()
                                  .Arg<ffi::AnyBuffer>()
                                  .Arg<ffi::AnyBuffer>()
                                  .Arg<ffi::Buffer<ffi::S32>>()
                                  .Ret<ffi::AnyBuffer>()
                                  .Ret<ffi::AnyBuffer>()
                                  .Ret<ffi::AnyBuffer>()
                                  .Ret<ffi::Buffer<ffi::PRED>>()
                                  .Ret<ffi::Buffer<ffi::S32>>());

}  // namespace gmmjax
