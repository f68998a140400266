#include <stillmap/mapping/progress_lines.hpp>

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <utility>

namespace stillmap::mapping {
namespace {

constexpr double kBetweenLinesS = 0.25;
/// A mean speed over less says nothing about the time that is left.
constexpr double kLeastForEta = 0.01;

}  // namespace

std::vector<StageShare> build_stages(bool registers) {
  // Of a build with the shipped network on two cores; odometry runs at about its speed.
  std::vector<StageShare> stages{
      {"odometry", 0.60}, {"describe places", 0.03}, {"check loops", 0.10}, {"pose graph", 0.02}};
  if (registers) stages.push_back({"register", 0.05});
  const std::vector<StageShare> passes{{"resume", 0.0},  {"survey", 0.75}, {"fuse", 0.03},
                                       {"place", 0.12},  {"clean", 0.0},   {"tiles", 0.08},
                                       {"publish", 0.01}};
  stages.insert(stages.end(), passes.begin(), passes.end());
  return stages;
}

ProgressLines::ProgressLines(std::vector<StageShare> plan,
                             std::function<void(std::string_view line)> write,
                             std::function<double()> now_s)
    : plan_(std::move(plan)),
      write_(std::move(write)),
      now_s_(std::move(now_s)),
      began_s_(now_s_()),
      written_s_(began_s_) {
  for (const StageShare& each : plan_) sum_ += each.share;
}

void ProgressLines::enter(std::string_view stage) {
  stage_ = stage;
  const auto next = std::find_if(plan_.begin() + static_cast<std::ptrdiff_t>(at_), plan_.end(),
                                 [&](const StageShare& each) { return each.stage == stage; });
  if (next == plan_.end() || !(sum_ > 0.0)) return;
  double before = 0.0;
  for (auto each = plan_.begin(); each != next; ++each) before += each->share / sum_;
  skipped_ += std::max(0.0, before - fraction_);
  fraction_ = std::max(fraction_, before);
  at_ = static_cast<std::size_t>(next - plan_.begin());
}

void ProgressLines::update(std::string_view stage, std::size_t done, std::size_t total) {
  const bool entered = stage != stage_;
  if (entered) enter(stage);
  if (at_ < plan_.size() && plan_[at_].stage == stage && total > 0 && sum_ > 0.0) {
    double before = 0.0;
    for (std::size_t i = 0; i < at_; ++i) before += plan_[i].share / sum_;
    const double share = std::min(1.0, static_cast<double>(done) / static_cast<double>(total));
    fraction_ = std::clamp(before + share * plan_[at_].share / sum_, fraction_, 1.0);
  }
  if (!entered && now_s_() - written_s_ < kBetweenLinesS) return;
  write_line(done, total, total > 0 ? fmt::format("{} {} of {}", stage, done, total) : stage_, {});
}

void ProgressLines::finish(std::string_view outcome, std::string_view message) {
  if (outcome == "succeeded") fraction_ = 1.0;
  write_line(0, 0, message, outcome);
}

std::optional<double> ProgressLines::eta_s() const {
  const double moved = fraction_ - skipped_;
  if (moved < kLeastForEta) return std::nullopt;
  return (now_s_() - began_s_) * (1.0 - fraction_) / moved;
}

void ProgressLines::write_line(std::size_t done, std::size_t total, std::string_view message,
                               std::string_view outcome) {
  nlohmann::ordered_json line;
  line["stage"] = stage_;
  line["done"] = done;
  line["total"] = total;
  line["fraction"] = fraction_;
  const std::optional<double> eta = outcome.empty() ? eta_s() : 0.0;
  line["eta_s"] = eta ? nlohmann::ordered_json(*eta) : nlohmann::ordered_json(nullptr);
  line["message"] = message;
  if (!outcome.empty()) line["outcome"] = outcome;
  // File names are any bytes.
  write_(line.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace) + "\n");
  written_s_ = now_s_();
}

std::string_view cancelled_line() {
  return R"({"stage":"","done":0,"total":0,"fraction":0.0,"eta_s":null,"message":"cancelled",)"
         R"("outcome":"cancelled"})"
         "\n";
}

}  // namespace stillmap::mapping
