// What the handlers of XLA's calls share.

#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "xla/ffi/api/ffi.h"

namespace gmmjax {

using Dimensions = xla::ffi::Span<const int64_t>;

inline int64_t product(Dimensions shape, size_t first, size_t last) {
  int64_t size = 1;
  for (size_t axis = first; axis < last; ++axis) size *= shape[axis];
  return size;
}

// The leading axes of an argument, which `vmap` added; of size 1 where the argument is the same for all of the stack.
class Axes {
 public:
  Axes(Dimensions shape, size_t axes) : steps_(axes) {
    int64_t step = product(shape, axes, shape.size());
    for (size_t axis = axes; axis-- > 0; step *= shape[axis]) steps_[axis] = shape[axis] == 1 ? 0 : step;
  }

  // Where the argument of the index-th of the stack begins.
  int64_t offset(Dimensions stack, int64_t index) const {
    int64_t offset = 0;
    for (size_t axis = steps_.size(); axis-- > 0; index /= stack[axis]) offset += index % stack[axis] * steps_[axis];
    return offset;
  }

 private:
  std::vector<int64_t> steps_;
};

XLA_FFI_DECLARE_HANDLER_SYMBOL(FeatureSums);
XLA_FFI_DECLARE_HANDLER_SYMBOL(FeatureSumsTangent);
XLA_FFI_DECLARE_HANDLER_SYMBOL(BalancedTransport);

}  // namespace gmmjax
