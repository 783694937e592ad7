// The result of a solve, as Python gets it.
#pragma once

#include <algorithm>
#include <memory>
#include <optional>

#include "graspforce/servo.hpp"
#include "interpreter.hpp"

namespace graspforce {

// The numbers of one solve, copied out of the engine: forces, multipliers, certificate; and for a
// tick those of its problem.
struct Outcome {
  Result result;
  std::size_t m, internals, k, limits;
  std::unique_ptr<double[]> data;
  Snapshot problem;

  Outcome(const Engine& engine, const Result& r, Snapshot numbers)
      : result(r),
        m(engine.layout().components()),
        internals(engine.layout().internals),
        k(engine.layout().wrench_rows),
        limits(r.status == Status::Infeasible ? engine.limits() : 0),
        problem(std::move(numbers)) {
    const bool proof = limits > 0;
    data.reset(new double[m + internals + k + (proof ? k + limits : 0)]);
    double* next = data.get();
    next = std::copy_n(engine.forces(), m + internals, next);
    next = std::copy_n(engine.multipliers(), k, next);
    if (proof) {
      next = std::copy_n(engine.certificate_y(), k, next);
      std::copy_n(engine.certificate_z(), limits, next);
    }
  }

  const double* c() const { return data.get(); }
  const double* internal_forces() const { return c() + m; }
  const double* nu() const { return internal_forces() + internals; }
  const double* y() const { return nu() + k; }
  const double* z() const { return y() + k; }
};

// Getter of one of an outcome's arrays, and of one that is there only with a certificate.
inline auto field(const double* (Outcome::*data)() const, std::size_t Outcome::* size) {
  return [data, size](nb::handle_t<Outcome> self) {
    const Outcome& outcome = nb::cast<const Outcome&>(self);
    return view(self, (outcome.*data)(), outcome.*size);
  };
}
inline auto proof(const double* (Outcome::*data)() const, std::size_t Outcome::* size) {
  return [data, size](nb::handle_t<Outcome> self) -> std::optional<NumpyVector> {
    const Outcome& outcome = nb::cast<const Outcome&>(self);
    if (outcome.limits == 0) return std::nullopt;
    return view(self, (outcome.*data)(), outcome.*size);
  };
}

}  // namespace graspforce
