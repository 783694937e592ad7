// Solves a batch: many problems of one layout, four at a time in the lanes of a register where they
// fit (batch_lanes.hpp), by the engine where they do not or where that does not certify them.
//
// A row's answer depends on that row alone: not on the rows beside it, their order or the number of
// threads. Statuses, certificates and promises are those of Engine::solve.
#pragma once

#include <algorithm>
#include <cmath>
#include <iterator>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "graspforce/batch_lanes.hpp"
#include "graspforce/batch_rows.hpp"
#include "graspforce/batch_threads.hpp"
#include "graspforce/engine.hpp"
#include "graspforce/validity.hpp"

namespace graspforce {

// Where the answers go: arrays of one entry, or one line, a row.
struct BatchAnswers {
  double *c, *nu;  // count × (m + r), count × k
  int *status, *newton_steps, *start, *nearest;
  double *decrement, *violation;

  void write(std::ptrdiff_t row, const Result& result) const {
    status[row] = int(result.status);
    newton_steps[row] = result.newton_steps;
    start[row] = int(result.start);
    decrement[row] = result.decrement;
    violation[row] = result.violation;
    nearest[row] = result.nearest;
  }
};

// The certificate of an infeasible row: y (k), then z (limit_count).
struct BatchProof {
  std::ptrdiff_t row;
  std::vector<double> numbers;
};

// What a thread solves rows with.
class BatchWorker {
 public:
  BatchWorker(const BatchRows& rows, const BatchAnswers& answers, std::vector<BatchProof>& proofs)
      : rows_(rows), answers_(answers), proofs_(proofs) {
    // A limit on the time of each row needs each by itself.
    if (rows.settings.budget_us == kInfinity) lanes_.emplace(rows);
  }

  template <class GoOn>
  void operator()(std::ptrdiff_t begin, std::ptrdiff_t end, GoOn go_on) {
    auto by_engine = [&](std::ptrdiff_t row) {
      if (go_on()) solve(row);
    };
    const auto in_lanes = [&](auto& lanes) { lanes.run(begin, end, *this, by_engine); };
    if (lanes_ && lanes_->use(in_lanes)) return;
    for (std::ptrdiff_t row = begin; row < end; ++row) by_engine(row);
  }

  // Takes what a lane has come to.
  template <class Answer>
  void write(std::ptrdiff_t row, const Answer& lane) {
    lane.get_forces(answers_.c + row * forces_);
    lane.get_multipliers(answers_.nu + row * k_);
    answers_.write(row, lane.result());
  }

 private:
  // Solves a row as Engine::solve does. Numbers that make no problem get InvalidNumbers; a start
  // that is not finite is refused like one outside the limits.
  void solve(std::ptrdiff_t row) {
    if (!engine_) {
      engine_.emplace(rows_.layout);
      packed_.resize(engine_->packed_size());
    }
    double *c = answers_.c + row * forces_, *nu = answers_.nu + row * k_;
    rows_.pack(row, packed_.data());
    if (find_flaw(rows_.layout, packed_.data())) {
      std::fill_n(c, forces_, 0.0);
      std::fill_n(nu, k_, 0.0);
      return answers_.write(row, Result());
    }
    const double* start = rows_.start_of(row);
    const auto is_finite = [](double force) { return std::isfinite(force); };
    if (start != nullptr && !std::all_of(start, start + m_, is_finite)) start = nullptr;
    engine_->forget();
    const Result& result = engine_->solve(packed_.data(), rows_.settings, start);
    std::copy_n(engine_->forces(), forces_, c);
    std::copy_n(engine_->multipliers(), k_, nu);
    answers_.write(row, result);
    if (result.status != Status::Infeasible) return;
    BatchProof proof{row, {engine_->certificate_y(), engine_->certificate_y() + k_}};
    proof.numbers.insert(proof.numbers.end(), engine_->certificate_z(),
                         engine_->certificate_z() + engine_->limits());
    proofs_.push_back(std::move(proof));
  }

  const BatchRows& rows_;
  const BatchAnswers& answers_;
  std::vector<BatchProof>& proofs_;
  const std::ptrdiff_t m_ = rows_.layout.components(), k_ = rows_.layout.wrench_rows;
  const std::ptrdiff_t forces_ = force_count(rows_.layout);  // the internal ones behind the m
  std::optional<LanesFor> lanes_;
  std::optional<Engine> engine_;  // made for the first row that needs it
  std::vector<double> packed_;
};

// Solves all rows into `answers`, on the calling thread and `threads` − 1 more; returns the
// certificates of the infeasible rows, in their order. `poll` is called now and then on the calling
// thread; where it returns false all stop, and there is no answer.
template <class Poll>
std::optional<std::vector<BatchProof>> solve_batch(const BatchRows& rows,
                                                   const BatchAnswers& answers, int threads,
                                                   Poll poll) {
  std::vector<std::vector<BatchProof>> found(threads_for(rows.count, threads));
  auto make = [&](int thread) { return BatchWorker(rows, answers, found[thread]); };
  if (!each_chunk(rows.count, threads, make, poll)) return std::nullopt;
  std::vector<BatchProof> proofs;
  for (std::vector<BatchProof>& part : found)
    std::move(part.begin(), part.end(), std::back_inserter(proofs));
  std::sort(proofs.begin(), proofs.end(),
            [](const BatchProof& a, const BatchProof& b) { return a.row < b.row; });
  return proofs;
}

}  // namespace graspforce
