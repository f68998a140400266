#pragma once

#include <stillmap/mapping/progress.hpp>

#include <cstddef>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace stillmap::mapping {

/// A stage of long work, and about which part of the whole it takes, in any unit, >= 0. If a share
/// is wrong, the bar only moves unevenly.
struct StageShare {
  std::string stage;
  double share = 0.0;
};

/// The stages that `build_map` tells of, in order.
/// @param registers  whether the map is brought into another one's frame.
[[nodiscard]] std::vector<StageShare> build_stages(bool registers);

/// Progress for programs: one JSON object a line, with the keys
///
///     stage     what is done now
///     done      units of it, an integer
///     total     units in all, an integer; 0 when not known
///     fraction  of everything, in [0, 1], never falling
///     eta_s     about how long everything still takes [s], null before that can be told
///     message   words for people
///
/// and on the last line alone `outcome`: `succeeded`, `failed` or `cancelled`. At most four lines a
/// second, and one more for each stage that begins.
class ProgressLines {
 public:
  /// @param write  takes a line with its newline.
  /// @param now_s  a clock that never goes back [s].
  ProgressLines(std::vector<StageShare> plan, std::function<void(std::string_view line)> write,
                std::function<double()> now_s);

  /// As `ProgressCallback`. A stage that the plan does not know moves nothing but the words.
  void update(std::string_view stage, std::size_t done, std::size_t total);
  /// The last line. @param outcome  one of the three.
  void finish(std::string_view outcome, std::string_view message);

 private:
  void enter(std::string_view stage);
  [[nodiscard]] std::optional<double> eta_s() const;
  void write_line(std::size_t done, std::size_t total, std::string_view message,
                  std::string_view outcome);

  std::vector<StageShare> plan_;
  std::function<void(std::string_view line)> write_;
  std::function<double()> now_s_;
  double began_s_;
  double written_s_;
  std::string stage_;
  /// Of the plan, the one that is done now or next.
  std::size_t at_ = 0;
  double sum_ = 0.0;
  double fraction_ = 0.0;
  /// Of the fraction, what was passed over because it was done before.
  double skipped_ = 0.0;
};

/// The last line of a program that ends without any more work, for a signal handler.
[[nodiscard]] std::string_view cancelled_line();

}  // namespace stillmap::mapping
