// The base class of graspforce.Solution: an object of two members, which the core fills without the
// call of __init__, because that takes longer than a Newton step.
//
// The type belongs to the module for baseline processors, which is always imported; the builds for
// others take it from there.
#pragma once

#include <structmember.h>

#include <cstring>

#include "interpreter.hpp"

namespace graspforce {

struct SolutionObject {
  PyObject_HEAD PyObject* outcome;
  PyObject* problem;  // a ForceProblem, or for a tick its Layout
};

inline PyTypeObject* solution_base = nullptr;

inline int traverse_solution(PyObject* self, visitproc visit, void* arg) {
  auto* solution = reinterpret_cast<SolutionObject*>(self);
  Py_VISIT(solution->outcome);
  Py_VISIT(solution->problem);
  Py_VISIT(Py_TYPE(self));
  return 0;
}

inline int clear_solution(PyObject* self) {
  auto* solution = reinterpret_cast<SolutionObject*>(self);
  Py_CLEAR(solution->outcome);
  Py_CLEAR(solution->problem);
  return 0;
}

inline void free_solution(PyObject* self) {
  PyTypeObject* type = Py_TYPE(self);
  PyObject_GC_UnTrack(self);
  clear_solution(self);
  type->tp_free(self);
  Py_DECREF(type);
}

inline PyMemberDef solution_members[] = {
    {"_outcome", T_OBJECT_EX, offsetof(SolutionObject, outcome), 0, nullptr},
    {"_problem", T_OBJECT_EX, offsetof(SolutionObject, problem), 0, nullptr},
    {nullptr, 0, 0, 0, nullptr}};

inline PyType_Slot solution_slots[] = {{Py_tp_doc, (void*)"Outcome and problem of a Solution."},
                                       {Py_tp_members, solution_members},
                                       {Py_tp_traverse, (void*)traverse_solution},
                                       {Py_tp_clear, (void*)clear_solution},
                                       {Py_tp_dealloc, (void*)free_solution},
                                       {0, nullptr}};

inline PyType_Spec solution_spec = {"graspforce._core.SolutionBase", sizeof(SolutionObject), 0,
                                    Py_TPFLAGS_DEFAULT | Py_TPFLAGS_BASETYPE | Py_TPFLAGS_HAVE_GC,
                                    solution_slots};

// Makes the type in the baseline module, and finds it there for the others.
inline void offer_solution_base(nb::module_& module) {
  constexpr const char* kBaseline = "graspforce._core";
  nb::object type;
  if (std::strcmp(PyModule_GetName(module.ptr()), kBaseline) == 0) {
    type = nb::steal(PyType_FromModuleAndSpec(module.ptr(), &solution_spec, nullptr));
    if (!type.is_valid()) nb::raise_python_error();
    module.attr("SolutionBase") = type;
  } else {
    type = nb::module_::import_(kBaseline).attr("SolutionBase");
  }
  solution_base = reinterpret_cast<PyTypeObject*>(type.release().ptr());
}

// An object of a class that derives from SolutionBase, of an outcome and its problem (or layout).
inline nb::object make_solution(nb::handle solution, nb::object outcome, nb::handle problem) {
  auto* type = reinterpret_cast<PyTypeObject*>(solution.ptr());
  if (!PyType_Check(solution.ptr()) || !PyType_IsSubtype(type, solution_base))
    throw nb::type_error("solution: expected a class that derives from SolutionBase");
  nb::object made = nb::steal(type->tp_alloc(type, 0));
  if (!made.is_valid()) nb::raise_python_error();
  auto* object = reinterpret_cast<SolutionObject*>(made.ptr());
  object->outcome = outcome.release().ptr();
  object->problem = nb::borrow(problem).release().ptr();
  return made;
}

}  // namespace graspforce
