#include "derived/derived_refusal.hpp"

#include "errors/api_error.hpp"
#include "errors/upload_errors.hpp"

namespace stillmap::server {

void require_under_way(const DerivedWorker::Answer& answer, const std::string& what,
                       const std::filesystem::path& store) {
  if (answer.state == DerivedWorker::State::kFull)
    throw ApiError(ErrorCode::kBusy, "too much else is being made").with_header("Retry-After", "5");
  if (answer.state == DerivedWorker::State::kFailed) {
    throw ApiError(ErrorCode::kDerivedUnavailable,
                   what + " could not be made: " + without_folder(answer.failure, store))
        .with_header("Retry-After", std::to_string(DerivedWorker::kPause.count()));
  }
}

void refuse_until_made(const DerivedWorker::Answer& answer, const std::string& what,
                       const std::filesystem::path& store) {
  require_under_way(answer, what, store);
  throw ApiError(ErrorCode::kBeingMade, what + " is being made").with_header("Retry-After", "1");
}

}  // namespace stillmap::server
