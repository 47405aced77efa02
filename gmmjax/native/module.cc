// The Python module: its function `targets` gives the handlers as capsules that `jax.ffi` registers.

#define PY_SSIZE_T_CLEAN
#define Py_LIMITED_API 0x030B0000
#include <Python.h>

#include "handlers.h"

namespace {

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
      add(targets, "gmmjax_transport", reinterpret_cast<void*>(gmmjax::BalancedTransport)) < 0) {
    Py_DECREF(targets);
    return nullptr;
  }
  return targets;
}

PyMethodDef methods[] = {{"targets", targets, METH_NOARGS, "The handlers of XLA's calls, by name."},
                         {nullptr, nullptr, 0, nullptr}};
PyModuleDef definition = {PyModuleDef_HEAD_INIT, "_kernels", "Compiled kernels of gmmjax.", 0, methods,
                          nullptr,               nullptr,    nullptr,                       nullptr};

}  // namespace

PyMODINIT_FUNC PyInit__kernels(void) { return PyModule_Create(&definition); }
