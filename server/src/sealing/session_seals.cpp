#include "sealing/session_seals.hpp"

#include "errors/api_error.hpp"
#include "store/ids_and_times.hpp"

#include <fmt/format.h>

#include <openssl/rand.h>

#include <algorithm>
#include <stdexcept>
#include <utility>
#include <vector>

namespace stillmap::server {
namespace {

constexpr std::int64_t kLifeNs =
    std::chrono::duration_cast<std::chrono::nanoseconds>(kSealLife).count();
/// Sessions whose counts are kept, twice: some 10 MB at most.
constexpr std::size_t kMostCounts = 65'536;

}  // namespace

SessionSeals::SessionSeals(std::unique_ptr<SealKeySource> keys,
                           std::function<std::int64_t()> now_ns)
    : keys_(std::move(keys)), now_ns_(now_ns ? std::move(now_ns) : unix_ns) {}

SealedSession SessionSeals::begin() const {
  SealedSession session;
  session.id.resize(SealedSession::kIdBytes);
  if (RAND_bytes(reinterpret_cast<unsigned char*>(session.id.data()),
                 static_cast<int>(session.id.size())) != 1)
    throw std::runtime_error("there is no randomness to make a session of");
  return session;
}

SealedSession SessionSeals::open(std::string_view text, const SealOwner& owner) const {
  std::optional<SealedSession> session;
  for (const SealKey& key : keys_->keys())
    if (!session) session = open_seal(text, owner, key);
  if (!session)
    throw ApiError(ErrorCode::kInvalidSeal,
                   "the seal cannot be used here: send the newest one unchanged, with the API key "
                   "and the map that it came for, to a server of the same store; or begin anew "
                   "without a seal");
  // A clock of another server may be ahead of this one's.
  const std::int64_t age_ns = now_ns_() - session->made_ns;
  if (age_ns > kLifeNs || age_ns < -kLifeNs)
    throw ApiError(ErrorCode::kSealExpired,
                   fmt::format("the seal was made {:.0f} s ago, and counts for {} s: begin anew "
                               "without a seal, best with a prior",
                               1e-9 * static_cast<double>(age_ns), kSealLife.count()));
  return *std::move(session);
}

std::string SessionSeals::next(SealedSession session, const SealOwner& owner, bool& is_replay) {
  session.made_ns = now_ns_();
  ++session.count;
  std::string text = seal(session, owner, keys_->keys().front());
  is_replay = note(session.id, session.count, session.made_ns);
  return text;
}

bool SessionSeals::note(const std::string& id, std::uint64_t count, std::int64_t now_ns) {
  const std::scoped_lock lock(mutex_);
  const bool too_old = now_ns - young_since_ns_ > kLifeNs || now_ns < young_since_ns_;
  if (young_.size() >= kMostCounts || too_old) {
    old_ = std::exchange(young_, {});
    young_since_ns_ = now_ns;
  }
  std::uint64_t newest = 0;
  for (const Counts* counts : {&old_, &young_})
    if (const auto found = counts->find(id); found != counts->end())
      newest = std::max(newest, found->second);
  young_[id] = std::max(newest, count);
  return count <= newest;
}

}  // namespace stillmap::server
