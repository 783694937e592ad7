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

inline graspforce::Span<double> field(const graspforce::Layout& layout,
                                      graspforce::ProblemData& data, const std::string& name) {
  graspforce::Span<double> found;
  graspforce::each_field(layout, [&](const graspforce::Field& field) {
    if (name == field.name) found = {data.packed() + field.offset, int(field.size())};
  });
  if (found.data() == nullptr) throw std::runtime_error("task: no field " + name);
  return found;
}

// Takes the fields of the next tick; false when there is none.
inline bool read_tick(std::istream& file, const graspforce::Layout& layout,
                      graspforce::ProblemData& data) {
  std::string name;
  while (file >> name && name != "tick") {
    for (double& number : field(layout, data, name)) file >> number;
    if (!file) throw std::runtime_error("task: numbers missing from " + name);
  }
  return bool(file);
}
