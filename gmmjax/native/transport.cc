// `gmmjax_transport` for XLA: the axes that `vmap` added, and the memory of one problem for all.

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

// Memory for the largest of the problems, all of which have the same shape.
class Memory {
 public:
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

 private:
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
  problem.width = (problem.columns + kTransportLanes - 1) / kTransportLanes * kTransportLanes;
  problem.words = (problem.rows + kWord - 1) / kWord;
  Memory memory(problem.rows, problem.columns, problem.width, problem.words);
  problem.workspace = memory.workspace;

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

}  // namespace

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
