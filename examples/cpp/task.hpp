// Reads what a task asks of a grasp from a text file: a line `layout …`, then lines of a field's
// name and its numbers, row by row; a line `tick` says that the fields stand for a tick.
#pragma once

#include <istream>
#include <stdexcept>
#include <string>

#include "graspforce/problem_data.hpp"

// wrench rows, joints, inequalities, whether there are ceilings, floors; each contact's components
inline graspforce::Layout read_layout(std::istream& file) {
  graspforce::Layout layout;
  std::string word;
  int contacts = 0;
  file >> word >> layout.wrench_rows >> layout.joints >> layout.inequalities >> layout.ceilings >>
      layout.floors >> contacts;
  for (int dim = 0; contacts > 0 && file >> dim; --contacts)
    layout.models.push_back(static_cast<graspforce::Model>(dim));
  if (!file || word != "layout") throw std::runtime_error("task: no layout at its beginning");
  return layout;
}

inline graspforce::Span<double> field(graspforce::ProblemData& data, const std::string& name) {
  if (name == "W") return data.W.entries();
  if (name == "f") return data.f;
  if (name == "J") return data.J.entries();
  if (name == "tau_lo") return data.tau_lo;
  if (name == "tau_hi") return data.tau_hi;
  if (name == "tau_bias") return data.tau_bias;
  if (name == "c_max") return data.c_max;
  if (name == "c_min") return data.c_min;
  if (name == "engagement") return data.engagement;
  if (name == "A") return data.A.entries();
  if (name == "b") return data.b;
  if (name == "mu") return data.mu;
  if (name == "gamma") return data.gamma;
  if (name == "alpha") return {&data.alpha, 1};
  throw std::runtime_error("task: no field " + name);
}

// Takes the fields of the next tick; false when there is none.
inline bool read_tick(std::istream& file, graspforce::ProblemData& data) {
  std::string name;
  while (file >> name && name != "tick") {
    for (double& number : field(data, name)) file >> number;
    if (!file) throw std::runtime_error("task: numbers missing from " + name);
  }
  return bool(file);
}
