// The Python module: its function `targets` gives the handlers as capsules that `jax.ffi` registers; the others compute
// on NumPy's arrays, without Python's lock.

#define PY_SSIZE_T_CLEAN
#define Py_LIMITED_API 0x030B0000
#include <Python.h>

#include <array>
#include <memory>
#include <new>

#include "handlers.h"
#include "packed_points.h"
#include "transport.h"

namespace {

constexpr char kPackedPoints[] = "gmmjax.PackedPoints";

int add(PyObject* targets, const char* name, void* handler) {
  PyObject* capsule = PyCapsule_New(handler, "xla._CUSTOM_CALL_TARGET", nullptr);
  if (capsule == nullptr) return -1;
  const int failed = PyDict_SetItemString(targets, name, capsule);
  Py_DECREF(capsule);
  return failed;
}

PyObject* targets(PyObject*, PyObject*) {
  PyObject* targets = PyDict_New();
  if (targets == nullptr) return nullptr;
  if (add(targets, "gmmjax_feature_sums", reinterpret_cast<void*>(gmmjax::FeatureSums)) < 0 ||
      add(targets, "gmmjax_feature_sums_tangent", reinterpret_cast<void*>(gmmjax::FeatureSumsTangent)) < 0 ||
      add(targets, "gmmjax_transport", reinterpret_cast<void*>(gmmjax::BalancedTransport)) < 0) {
    Py_DECREF(targets);
    return nullptr;
  }
  return targets;
}

// The memory of contiguous arrays, for as long as this lives.
template <int kCount>
class Arrays {
 public:
  Arrays() = default;
  Arrays(const Arrays&) = delete;
  ~Arrays() {
    for (Py_buffer& view : views_)
      if (view.obj != nullptr) PyBuffer_Release(&view);
  }

  Py_buffer& operator[](int index) { return views_[index]; }

  template <typename T>
  T* of(int index) {
    return static_cast<T*>(views_[index].buf);
  }

  // Whether an array has so many numbers, all of which are of eight bytes.
  bool holds(int index, Py_ssize_t numbers) const { return views_[index].len == numbers * Py_ssize_t(sizeof(double)); }

 private:
  std::array<Py_buffer, kCount> views_{};
};

void forget(PyObject* capsule) {
  delete static_cast<gmmjax::PackedPoints*>(PyCapsule_GetPointer(capsule, kPackedPoints));
}

PyObject* packed_points(PyObject*, PyObject* arguments) {
  Arrays<1> arrays;
  if (!PyArg_ParseTuple(arguments, "y*", &arrays[0])) return nullptr;
  const Py_ssize_t count = arrays[0].len / Py_ssize_t(3 * sizeof(double));
  if (count == 0 || !arrays.holds(0, 3 * count)) {
    PyErr_SetString(PyExc_ValueError, "points must be float64 [count, 3], and one at least");
    return nullptr;
  }
  std::unique_ptr<gmmjax::PackedPoints> packed;
  Py_BEGIN_ALLOW_THREADS;
  try {
    packed = std::make_unique<gmmjax::PackedPoints>(arrays.of<double>(0), count);
  } catch (const std::bad_alloc&) {
  }
  Py_END_ALLOW_THREADS;
  if (packed == nullptr) return PyErr_NoMemory();
  PyObject* capsule = PyCapsule_New(packed.get(), kPackedPoints, forget);
  if (capsule != nullptr) packed.release();
  return capsule;
}

PyObject* projections(PyObject*, PyObject* arguments) {
  PyObject* capsule;
  Arrays<7> arrays;
  if (!PyArg_ParseTuple(arguments, "Oy*y*y*y*w*w*w*", &capsule, &arrays[0], &arrays[1], &arrays[2], &arrays[3], &arrays[4],
                        &arrays[5], &arrays[6]))
    return nullptr;
  gmmjax::CylinderProblem problem;
  const auto* points = static_cast<gmmjax::PackedPoints*>(PyCapsule_GetPointer(capsule, kPackedPoints));
  if (points == nullptr) return nullptr;
  problem.count = arrays[2].len / Py_ssize_t(sizeof(double));
  bool fit = arrays.holds(0, 3 * problem.count) && arrays.holds(1, 3 * problem.count);
  for (int index = 2; index < 7; ++index) fit = fit && arrays.holds(index, problem.count);
  if (!fit) {
    PyErr_SetString(PyExc_ValueError, "arrays of cylinders must be of one length, and of eight bytes a number");
    return nullptr;
  }
  problem.centres = arrays.of<double>(0), problem.axes = arrays.of<double>(1), problem.radii = arrays.of<double>(2);
  problem.half_lengths = arrays.of<double>(3), problem.found = arrays.of<int64_t>(4);
  problem.mean = arrays.of<double>(5), problem.variance = arrays.of<double>(6);
  bool computed = false;
  Py_BEGIN_ALLOW_THREADS;
  try {
    points->project(problem);
    computed = true;
  } catch (const std::bad_alloc&) {
  }
  Py_END_ALLOW_THREADS;
  if (!computed) return PyErr_NoMemory();
  Py_RETURN_NONE;
}

PyObject* exact_transport(PyObject*, PyObject* arguments) {
  Arrays<7> arrays;
  gmmjax::ExactProblem problem;
  if (!PyArg_ParseTuple(arguments, "y*y*y*z*iw*w*w*", &arrays[0], &arrays[1], &arrays[2], &arrays[3],
                        &problem.most_augmentations, &arrays[4], &arrays[5], &arrays[6]))
    return nullptr;
  const Py_ssize_t rows = arrays[0].len / Py_ssize_t(sizeof(double));
  const Py_ssize_t columns = arrays[1].len / Py_ssize_t(sizeof(double));
  if (!arrays.holds(0, rows) || !arrays.holds(1, columns) || !arrays.holds(2, rows * columns) ||
      !(arrays[3].buf == nullptr || arrays.holds(3, columns)) || !arrays.holds(4, rows * columns) ||
      !arrays.holds(5, 2 * rows) || !arrays.holds(6, 2 * columns)) {
    PyErr_SetString(PyExc_ValueError, "arrays of a transport problem must be float64 and fit together");
    return nullptr;
  }
  problem.rows = int(rows), problem.columns = int(columns);
  problem.before = arrays.of<double>(0), problem.after = arrays.of<double>(1), problem.cost = arrays.of<double>(2);
  problem.start = arrays.of<double>(3), problem.plan = arrays.of<double>(4);
  problem.of_before = arrays.of<double>(5), problem.of_after = arrays.of<double>(6);
  gmmjax::ExactCost solved{0, nullptr};
  Py_BEGIN_ALLOW_THREADS;
  try {
    solved = gmmjax::exact_transport(problem);
  } catch (const std::bad_alloc&) {
  }
  Py_END_ALLOW_THREADS;
  if (solved.status == nullptr) return PyErr_NoMemory();
  return Py_BuildValue("ds", solved.cost, solved.status);
}

PyMethodDef methods[] = {
    {"targets", targets, METH_NOARGS, "The handlers of XLA's calls, by name."},
    {"packed_points", packed_points, METH_VARARGS, "A tree of points: float64 [count, 3]."},
    {"projections", projections, METH_VARARGS, "The points of a tree in cylinders, see gmmjax.changes.cylinders."},
    {"exact_transport", exact_transport, METH_VARARGS, "Cost and status, see gmmjax.transport.exact."},
    {nullptr, nullptr, 0, nullptr}};
PyModuleDef definition = {PyModuleDef_HEAD_INIT, "_kernels", "Compiled kernels of gmmjax.", 0, methods,
                          nullptr,               nullptr,    nullptr,                       nullptr};

}  // namespace

PyMODINIT_FUNC PyInit__kernels(void) { return PyModule_Create(&definition); }
