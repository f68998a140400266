#include "catalog/lazy_aligner.hpp"

#include "errors/api_error.hpp"

#include <fmt/format.h>

#include <mutex>
#include <utility>

namespace stillmap::server {
namespace {

[[noreturn]] void refuse(const DerivedWorker::Answer& answer, const std::string& what) {
  using State = DerivedWorker::State;
  if (answer.state == State::kFull)
    throw ApiError(ErrorCode::kBusy, "too much else is being made").with_header("Retry-After", "5");
  if (answer.state == State::kFailed) {
    // Why, stands in the log: it may name places of this machine.
    throw ApiError(ErrorCode::kMapUnusable, what + " cannot be prepared; the server's log says why")
        .with_header("Retry-After", std::to_string(DerivedWorker::kPause.count()));
  }
  throw ApiError(
      ErrorCode::kMapLoading,
      what +
          " is being prepared, which takes some seconds; send the request again after Retry-After")
      .with_header("Retry-After", "1");
}

}  // namespace

/// Shared with the work, which may end when nobody wants it any more.
struct LazyAligner::State {
  std::mutex mutex;
  std::shared_ptr<const localization::Aligner> aligner;
  Maker make;
};

LazyAligner::LazyAligner(std::string what, Maker make, DerivedWorker& worker)
    : what_(std::move(what)), state_(std::make_shared<State>()), worker_(worker) {
  state_->make = std::move(make);
}

LazyAligner::~LazyAligner() = default;

std::shared_ptr<const localization::Aligner> LazyAligner::made() const {
  const std::scoped_lock lock(state_->mutex);
  return state_->aligner;
}

localization::AlignmentResult LazyAligner::align(
    const maps::PointCloud& scan_lidar, const std::optional<localization::Prior>& prior) const {
  if (const auto aligner = made()) return aligner->align(scan_lidar, prior);
  const auto work = [state = state_](const maps::DerivedWork&) {
    // One that was made while this one waited.
    if (std::scoped_lock lock(state->mutex); state->aligner) return;
    std::shared_ptr<const localization::Aligner> aligner = state->make();
    const std::scoped_lock lock(state->mutex);
    state->aligner = std::move(aligner);
  };
  // Two copies of a map are not one: each asks for its own.
  const std::string key = fmt::format("{} ({})", what_, static_cast<const void*>(state_.get()));
  const DerivedWorker::Answer answer = worker_.ask(key, work);
  if (const auto aligner = made()) return aligner->align(scan_lidar, prior);
  refuse(answer, what_);
}

}  // namespace stillmap::server
