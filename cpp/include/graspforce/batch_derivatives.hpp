// Derivatives of a batch's answers: KKT systems, and gradients by everything in the problems.
//
// What a row gets depends on that row alone, as in batch.hpp.
#pragma once

#include <algorithm>
#include <memory>
#include <optional>
#include <vector>

#include "graspforce/adjoint.hpp"
#include "graspforce/batch_lanes.hpp"
#include "graspforce/batch_rows.hpp"
#include "graspforce/batch_threads.hpp"
#include "graspforce/factor.hpp"

namespace graspforce {

// The forces c (m + r) and multipliers nu (k) of each row, and which rows have derivatives.
struct BatchOptima {
  const double *c, *nu;
  bool* wanted;  // cleared where the forces are not strictly inside every limit
};

// Solves the KKT systems of factor.hpp of rows, each for one right-hand side (g, r).
class KktWorker {
 public:
  KktWorker(const BatchRows& rows, const BatchOptima& optima)
      : rows_(rows), optima_(optima), lanes_(rows) {}

  // In place for the rows from `begin` to `end`, that of `begin` first in x; zeros in rows that are
  // not wanted.
  void operator()(std::ptrdiff_t begin, std::ptrdiff_t end, double* x) {
    auto by_factor = [&](std::ptrdiff_t row) {
      bool& wanted = optima_.wanted[row];
      if (wanted) solve(row, x + (row - begin) * line_);
    };
    const auto in_lanes = [&](auto& lanes) {
      lanes.solve_kkt(begin, end, optima_.c + begin * forces_, optima_.wanted + begin, x,
                      by_factor);
    };
    if (!lanes_.use(in_lanes))
      for (std::ptrdiff_t row = begin; row < end; ++row) by_factor(row);
    for (std::ptrdiff_t row = begin; row < end; ++row)
      if (!optima_.wanted[row]) std::fill_n(x + (row - begin) * line_, line_, 0.0);
  }

 private:
  void solve(std::ptrdiff_t row, double* x) {
    if (!factor_) {
      factor_.emplace(rows_.layout);
      packed_.resize(Offsets(rows_.layout).size);
    }
    rows_.pack(row, packed_.data());
    factor_->forget();
    optima_.wanted[row] = factor_->at(packed_.data(), optima_.c + row * forces_);
    if (optima_.wanted[row]) factor_->solve(x, 1);
  }

  const BatchRows& rows_;
  const BatchOptima& optima_;
  const std::ptrdiff_t forces_ = force_count(rows_.layout);
  const std::ptrdiff_t line_ = forces_ + rows_.layout.wrench_rows;
  LanesFor lanes_;
  std::optional<Factor> factor_;  // made for the first row that needs it
  std::vector<double> packed_;
};

// Solves the KKT systems of all rows in place; x is count × (m + r + k). False where `poll` said
// stop.
template <class Poll>
bool solve_batch_kkt(const BatchRows& rows, const BatchOptima& optima, double* x, int threads,
                     Poll poll) {
  const std::ptrdiff_t line = force_count(rows.layout) + rows.layout.wrench_rows;
  auto make = [&](int) {
    return [&, solve = std::make_unique<KktWorker>(rows, optima)](std::ptrdiff_t begin,
                                                                  std::ptrdiff_t end, auto) {
      (*solve)(begin, end, x + begin * line);
    };
  };
  return each_chunk(rows.count, threads, make, poll);
}

// Gradients of L by the answers, of steps as in Column; those of the fields, side by side.
struct BatchGradients {
  Column c, internal_forces, tau, phi, friction_margins, torque_margins;
  Fields<double*> fields;  // null where nobody wants them

  AnswerGradients of_answer(std::ptrdiff_t row) const {
    const auto at = [row](Column column) {
      return column.first == nullptr ? nullptr : column.first + row * column.step;
    };
    return {at(c), at(internal_forces), at(tau), at(phi), at(friction_margins), at(torque_margins)};
  }
  Fields<double*> of_fields(const Layout& l, std::ptrdiff_t row) const {
    Fields<double*> out;
#define GRASPFORCE_LINE(name, type, rows, columns, ...) \
  out.name = fields.name == nullptr ? nullptr : fields.name + row * ((rows) * (columns));
    GRASPFORCE_FIELDS(GRASPFORCE_LINE)
#undef GRASPFORCE_LINE
    return out;
  }
};

// Pulls gradients of L by the answers back to the fields of all rows; zeros in rows that are not
// wanted. False where `poll` said stop.
template <class Poll>
bool pull_back_batch(const BatchRows& rows, const BatchOptima& optima,
                     const BatchGradients& gradients, int threads, Poll poll) {
  const std::ptrdiff_t forces = force_count(rows.layout), k = rows.layout.wrench_rows;
  struct Work {
    Work(const BatchRows& rows, const BatchOptima& optima)
        : solve(rows, optima),
          adjoint(rows.layout),
          x(std::size_t(kRowsAtOnce) * (force_count(rows.layout) + rows.layout.wrench_rows)) {}
    KktWorker solve;
    Adjoint adjoint;
    std::vector<double> x;
  };
  auto make = [&](int) {
    return [&, work = std::make_unique<Work>(rows, optima)](std::ptrdiff_t begin,
                                                            std::ptrdiff_t end, auto) {
      double* const x = work->x.data();
      const auto each = [&](auto what) {
        for (std::ptrdiff_t row = begin; row < end; ++row)
          what(row, x + (row - begin) * (forces + k), gradients.of_fields(rows.layout, row));
      };
      each([&](std::ptrdiff_t row, double* side, const Fields<double*>& out) {
        if (optima.wanted[row])
          work->adjoint.begin(rows.problem(row), optima.c + row * forces, gradients.of_answer(row),
                              out, side);
        else
          work->adjoint.clear(out);
      });
      work->solve(begin, end, x);
      each([&](std::ptrdiff_t row, double* side, const Fields<double*>& out) {
        if (optima.wanted[row])
          work->adjoint.end(rows.problem(row), optima.c + row * forces, optima.nu + row * k,
                            gradients.of_answer(row), side, side + forces, out);
        else
          work->adjoint.clear(out);
      });
    };
  };
  return each_chunk(rows.count, threads, make, poll);
}

}  // namespace graspforce
