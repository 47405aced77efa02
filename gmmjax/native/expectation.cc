// `gmmjax_feature_sums` and `gmmjax_feature_sums_tangent` for XLA: the widest instruction set of this machine, and the
// axes that `vmap` added.

#include <vector>

#include "handlers.h"

#include "expectation.h"
#include "instructions.h"

namespace gmmjax {
namespace {

namespace ffi = xla::ffi;

constexpr size_t kCacheLine = 64;

template <typename T>
using Kernel = void (*)(const ExpectationProblem<T>&);

// The next cache line: a vector that lies across two lines is loaded in twice the time.
template <typename T>
T* aligned(T* memory) {
  return memory + (kCacheLine - reinterpret_cast<uintptr_t>(memory) % kCacheLine) % kCacheLine / sizeof(T);
}

// The sums and the log likelihood, or with tangents those of the sums alone.
template <typename T>
ffi::Error add_all(ffi::AnyBuffer parameters, ffi::AnyBuffer points, ffi::AnyBuffer mass, ffi::AnyBuffer* tangents,
                   ffi::AnyBuffer& sums, ffi::AnyBuffer* log_likelihood) {
  static const Kernel<T> kernel = GMMJAX_VERSION(Kernel<T>, add_up);
  const auto shape = parameters.dimensions(), cloud = points.dimensions();
  const size_t axes = shape.size() - 2;
  const int rows = int(shape[axes]), features = int(shape[axes + 1]);

  std::vector<int> indices(2 * rows);
  std::vector<double> totals(size_t(rows) * features);
  std::vector<T> scratch(size_t(rows) * features * kMostLanes + 2 * size_t(rows + 1) * kMostBlock +
                         size_t(features + 1) * kMostBlock + kCacheLine / sizeof(T));
  ExpectationProblem<T> problem;
  problem.rows = rows, problem.features = features;
  problem.chunks = cloud[axes], problem.chunk_size = cloud[axes + 2];
  problem.workspace.live = indices.data(), problem.workspace.present = indices.data() + rows;
  problem.workspace.totals = totals.data();
  problem.workspace.sums = aligned(scratch.data());
  problem.workspace.joint = problem.workspace.sums + size_t(rows) * features * kMostLanes;
  problem.workspace.tangents = problem.workspace.joint + size_t(rows + 1) * kMostBlock;
  problem.workspace.padded = problem.workspace.tangents + size_t(rows + 1) * kMostBlock;

  const Axes of_parameters(shape, axes), of_points(cloud, axes), of_mass(mass.dimensions(), axes);
  const Axes of_tangents((tangents == nullptr ? parameters : *tangents).dimensions(), axes);
  const auto stack = sums.dimensions();
  const int64_t count = product(stack, 0, axes);
  T unused;
  for (int64_t index = 0; index < count; ++index) {
    problem.parameters = parameters.typed_data<T>() + of_parameters.offset(stack, index);
    problem.tangents = tangents == nullptr ? nullptr : tangents->typed_data<T>() + of_tangents.offset(stack, index);
    problem.points = points.typed_data<T>() + of_points.offset(stack, index);
    problem.mass = mass.typed_data<T>() + of_mass.offset(stack, index);
    problem.sums = sums.typed_data<T>() + index * rows * features;
    problem.log_likelihood = log_likelihood == nullptr ? &unused : log_likelihood->typed_data<T>() + index;
    kernel(problem);
  }
  return ffi::Error::Success();
}

ffi::Error add_any(ffi::AnyBuffer parameters, ffi::AnyBuffer points, ffi::AnyBuffer mass, ffi::AnyBuffer* tangents,
                   ffi::AnyBuffer& sums, ffi::AnyBuffer* log_likelihood) {
  switch (parameters.element_type()) {
    case ffi::F64:
      return add_all<double>(parameters, points, mass, tangents, sums, log_likelihood);
    case ffi::F32:
      return add_all<float>(parameters, points, mass, tangents, sums, log_likelihood);
    default:
      return ffi::Error::InvalidArgument("the E-step's kernels compute in float32 and float64");
  }
}

ffi::Error feature_sums(ffi::AnyBuffer parameters, ffi::AnyBuffer points, ffi::AnyBuffer mass,
                        ffi::Result<ffi::AnyBuffer> sums, ffi::Result<ffi::AnyBuffer> log_likelihood) {
  return add_any(parameters, points, mass, nullptr, *sums, &*log_likelihood);
}

ffi::Error feature_sums_tangent(ffi::AnyBuffer parameters, ffi::AnyBuffer points, ffi::AnyBuffer mass,
                                ffi::AnyBuffer tangents, ffi::Result<ffi::AnyBuffer> sums) {
  return add_any(parameters, points, mass, &tangents, *sums, nullptr);
}

}  // namespace

XLA_FFI_DEFINE_HANDLER_SYMBOL(FeatureSums, feature_sums,
                              ffi::Ffi::Bind()
                                  .Arg<ffi::AnyBuffer>()
                                  .Arg<ffi::AnyBuffer>()
                                  .Arg<ffi::AnyBuffer>()
                                  .Ret<ffi::AnyBuffer>()
                                  .Ret<ffi::AnyBuffer>());

XLA_FFI_DEFINE_HANDLER_SYMBOL(FeatureSumsTangent, feature_sums_tangent,
                              ffi::Ffi::Bind()
                                  .Arg<ffi::AnyBuffer>()
                                  .Arg<ffi::AnyBuffer>()
                                  .Arg<ffi::AnyBuffer>()
                                  .Arg<ffi::AnyBuffer>()
                                  .Ret<ffi::AnyBuffer>());

}  // namespace gmmjax
