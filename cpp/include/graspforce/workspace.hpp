// Engines for problems of changing layouts: what a thread keeps so that only a new layout
// allocates.
//
// An Engine's memory is made with it and grows with the square of the components that joints or
// inequalities can tie together (33 MB for 256 fingertips of three joints). A Workspace keeps the
// engines that were used last, at most kMostEngines of them and kMostBytes in all; the one in use
// stays however large it is. Its memory goes with it. Workspaces share nothing: use one a thread.
#pragma once

#include <algorithm>
#include <cstddef>
#include <memory>
#include <vector>

#include "graspforce/engine.hpp"

namespace graspforce {

// About how many bytes the engine of a layout takes.
inline std::size_t engine_bytes(const Layout& layout) {
  const std::size_t m = layout.components(), lines = unknowns(layout) + most_rows(layout);
  const std::size_t shared = layout.joints + layout.inequalities;
  return 24 * lines * largest_block(layout) + 1500 * lines + (7 * m + 600) * shared + 1000;
}

class Workspace {
 public:
  static constexpr std::size_t kMostEngines = 16, kMostBytes = std::size_t{64} << 20;

  // The engine of a layout, made where there is none; valid until the next call.
  Engine& engine(const Layout& layout) {
    return engine([&](const Layout& other) { return other == layout; }, [&] { return layout; });
  }
  // The same for callers that can tell without a Layout whether one is theirs (`matches`), and make
  // it only for a new engine (`make_layout`).
  template <class Matches, class MakeLayout>
  Engine& engine(Matches matches, MakeLayout make_layout) {
    auto found = std::find_if(kept_.begin(), kept_.end(),
                              [&](const Kept& kept) { return matches(kept.engine->layout()); });
    if (found == kept_.end()) {
      const Layout layout = make_layout();
      const std::size_t bytes = engine_bytes(layout);
      while (kept_.size() == kMostEngines || (!kept_.empty() && bytes_ + bytes > kMostBytes)) {
        bytes_ -= kept_.back().bytes;
        kept_.pop_back();
      }
      kept_.push_back({std::make_unique<Engine>(layout), bytes});
      bytes_ += bytes;
      found = kept_.end() - 1;
    }
    std::rotate(kept_.begin(), found, found + 1);
    return *kept_.front().engine;
  }

  std::size_t engines() const { return kept_.size(); }
  std::size_t bytes() const { return bytes_; }  // of all engines, about

 private:
  struct Kept {
    std::unique_ptr<Engine> engine;
    std::size_t bytes;
  };

  std::vector<Kept> kept_;  // the last used first
  std::size_t bytes_ = 0;
};

}  // namespace graspforce
