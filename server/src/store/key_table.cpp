#include "store/key_table.hpp"

#include <openssl/crypto.h>

#include <algorithm>
#include <chrono>
#include <stdexcept>
#include <utility>

#include <stillmap/maps/error.hpp>
#include <stillmap/maps/sha256.hpp>
#include "store/ids_and_times.hpp"
#include "store/postgres_database.hpp"
#include "store/store_database.hpp"

namespace stillmap::server {
namespace {

using Reading = StoreDatabase::Reading;
using ReadingBeside = StoreDatabase::ReadingBeside;
using Writing = StoreDatabase::Writing;
using Verdict = KeyCheck::Verdict;

constexpr std::string_view kPrefix = "stillmap_";
/// Hex digits: 64 bits tell keys apart, 256 bits cannot be guessed.
constexpr std::size_t kIdDigits = 16;
constexpr std::size_t kSecretDigits = 64;
constexpr const char* kSelectKeys =
    "SELECT id, name, scopes, created_ns, expires_ns, revoked_ns, secret_sha256, maps FROM keys ";
/// Patterns are kept as one text, a line each.
constexpr char kBetweenMaps = '\n';

std::vector<std::string> maps_of(const std::string& text) {
  std::vector<std::string> maps;
  for (std::size_t begin = 0; begin < text.size();) {
    const std::size_t end = std::min(text.find(kBetweenMaps, begin), text.size());
    maps.push_back(text.substr(begin, end - begin));
    begin = end + 1;
  }
  return maps;
}

std::string text_of(const std::vector<std::string>& maps) {
  std::string text;
  for (const std::string& map : maps) text += map + kBetweenMaps;
  return text;
}

ApiKey key_of(const Statement& row) {
  return {row.text(0),
          row.text(1),
          {static_cast<std::uint8_t>(row.integer(2))},
          row.integer(3),
          row.optional_integer(4),
          row.optional_integer(5),
          maps_of(row.text(7))};
}

std::string sha256_of_secret(std::string_view secret) {
  maps::Sha256 hash;
  hash.add(secret.data(), secret.size());
  return hash.hex();
}

void check_new_key(std::string_view name, KeyScopes scopes, std::optional<std::int64_t> expires_ns,
                   std::int64_t now_ns) {
  constexpr std::size_t kLongestName = 100;
  const auto is_control = [](char c) { return static_cast<unsigned char>(c) < 0x20 || c == 0x7f; };
  if (name.empty() || name.size() > kLongestName ||
      std::any_of(name.begin(), name.end(), is_control))
    throw std::invalid_argument(
        "name of a key: 1 to 100 bytes without control characters expected");
  if (scopes.bits == 0 || scopes.bits > 15)
    throw std::invalid_argument("scopes of a key: at least one of read, localize, write, admin");
  if (expires_ns && *expires_ns <= now_ns)
    throw std::invalid_argument("expiry of a key: a time to come expected");
}

void check_maps(const std::vector<std::string>& maps, KeyScopes scopes) {
  if (maps.size() > kMostMapPatterns)
    throw std::invalid_argument("maps of a key: found " + std::to_string(maps.size()) +
                                " patterns, expected at most " + std::to_string(kMostMapPatterns));
  for (const std::string& map : maps)
    if (!is_map_pattern(map))
      throw std::invalid_argument("map of a key: found '" + map +
                                  "', 1 to 63 of [a-z0-9._-] and * expected");
  if (!maps.empty() && scopes.has(KeyScope::kAdmin))
    throw std::invalid_argument(
        "maps of a key: a key with the scope admin makes keys for any map and reads the audit log "
        "of all, so it cannot be limited to maps: leave out the scope admin, or the maps");
}

}  // namespace

bool is_map_pattern(std::string_view text) {
  constexpr std::string_view kAllowed = "abcdefghijklmnopqrstuvwxyz0123456789._-*";
  constexpr std::size_t kLongest = 63;
  return !text.empty() && text.size() <= kLongest &&
         text.find_first_not_of(kAllowed) == std::string_view::npos;
}

bool matches_pattern(std::string_view name, std::string_view pattern) {
  std::size_t at = 0;
  std::size_t in_pattern = 0;
  // Where the latest star was, and the first place behind what it stands for.
  std::size_t star = std::string_view::npos;
  std::size_t behind = 0;
  while (at < name.size()) {
    if (in_pattern < pattern.size() && pattern[in_pattern] == '*') {
      star = in_pattern++;
      behind = at;
    } else if (in_pattern < pattern.size() && pattern[in_pattern] == name[at]) {
      ++in_pattern;
      ++at;
    } else if (star != std::string_view::npos) {
      in_pattern = star + 1;
      at = ++behind;
    } else {
      return false;
    }
  }
  return pattern.find_first_not_of('*', in_pattern) == std::string_view::npos;
}

std::string_view name_of(KeyScope scope) {
  switch (scope) {
    case KeyScope::kRead:
      return "read";
    case KeyScope::kLocalize:
      return "localize";
    case KeyScope::kWrite:
      return "write";
    case KeyScope::kAdmin:
      return "admin";
  }
  throw std::invalid_argument("not a scope");
}

const std::vector<KeyScope>& all_key_scopes() {
  static const std::vector<KeyScope> scopes = {KeyScope::kRead, KeyScope::kLocalize,
                                               KeyScope::kWrite, KeyScope::kAdmin};
  return scopes;
}

KeyTable::Created KeyTable::create(std::string_view name, KeyScopes scopes,
                                   std::optional<std::int64_t> expires_ns, std::int64_t now_ns,
                                   const std::vector<std::string>& maps) {
  check_new_key(name, scopes, expires_ns, now_ns);
  check_maps(maps, scopes);
  const std::string secret = random_hex(kSecretDigits);
  Created created{{random_hex(kIdDigits), std::string(name), scopes, now_ns, expires_ns, {}, maps},
                  {}};
  created.text = std::string(kPrefix) + created.key.id + "_" + secret;
  Writing writing(*database_);
  Statement(writing.database(),
            "INSERT INTO keys (id, name, scopes, secret_sha256, created_ns, expires_ns, maps)"
            " VALUES (?, ?, ?, ?, ?, ?, ?)")
      .bind(created.key.id)
      .bind(name)
      .bind(static_cast<std::int64_t>(scopes.bits))
      .bind(sha256_of_secret(secret))
      .bind(now_ns)
      .bind(expires_ns)
      .bind(text_of(maps))
      .step();
  writing.commit();
  note_change();
  return created;
}

std::vector<ApiKey> KeyTable::list() const {
  const ReadingBeside reading(*database_);
  Statement row(reading.database(), std::string(kSelectKeys) + "ORDER BY created_ns, id");
  std::vector<ApiKey> keys;
  while (row.step()) keys.push_back(key_of(row));
  return keys;
}

ApiKey KeyTable::revoke(std::string_view id, std::int64_t now_ns) {
  return database_->even_when_full([&] {
    Writing writing(*database_);
    Statement row(writing.database(), std::string(kSelectKeys) + "WHERE id = ?");
    if (!row.bind(id).step())
      throw StoreRefusal(StoreRefusal::Reason::kUnknownKey,
                         "there is no key '" + std::string(id) + "'");
    ApiKey key = key_of(row);
    if (!key.revoked_ns) {
      key.revoked_ns = now_ns;
      Statement(writing.database(), "UPDATE keys SET revoked_ns = ? WHERE id = ?")
          .bind(now_ns)
          .bind(id)
          .step();
    }
    writing.commit();
    note_change();
    return key;
  });
}

KeyCheck KeyTable::check(std::string_view text, std::int64_t now_ns) const {
  // The shape is no secret.
  if (text.size() != kPrefix.size() + kIdDigits + 1 + kSecretDigits || !text.starts_with(kPrefix) ||
      text[kPrefix.size() + kIdDigits] != '_')
    return {};
  const std::string_view id = text.substr(kPrefix.size(), kIdDigits);
  const std::string given = sha256_of_secret(text.substr(kPrefix.size() + kIdDigits + 1));
  // Compared with an unknown id's secret too; no secret is known that has this sum.
  std::string kept(given.size(), '0');
  std::optional<ApiKey> key;
  const std::shared_ptr<const KnownKeys> keys = known();
  if (const auto found = keys->find(id); found != keys->end()) {
    key = found->second.key;
    kept = found->second.secret_sha256;
  }
  const bool same =
      kept.size() == given.size() && CRYPTO_memcmp(kept.data(), given.data(), given.size()) == 0;
  if (!same || !key) return {};
  if (key->revoked_ns) return {Verdict::kRevoked, std::move(key)};
  if (key->expires_ns && *key->expires_ns <= now_ns) return {Verdict::kExpired, std::move(key)};
  return {Verdict::kGood, std::move(key)};
}

bool KeyTable::any() const { return !known()->empty(); }

std::shared_ptr<const KeyTable::KnownKeys> KeyTable::known() const {
  if (!database_->told_mark()) return read();
  {
    // No vehicle waits for a PostgreSQL that does not answer.
    const std::scoped_lock lock(mutex_);
    if (known_ && known_at_ >= needed_at_) return known_;
  }
  auto keys = read();
  std::call_once(is_followed_, [&] {
    follower_ = std::jthread([this](const std::stop_token& stop) { follow(stop); });
  });
  return keys;
}

std::shared_ptr<const KeyTable::KnownKeys> KeyTable::read() const {
  const ReadingBeside reading(*database_);
  try {
    // It changes with every commit of another connection, and all that change anything are others.
    const std::int64_t at = reading.database().change_mark();
    {
      const std::scoped_lock lock(mutex_);
      if (known_ && at == known_at_) return known_;
    }
    auto keys = std::make_shared<KnownKeys>();
    Statement row(reading.database(), kSelectKeys);
    while (row.step()) keys->insert_or_assign(row.text(0), Known{key_of(row), row.text(6)});
    const std::scoped_lock lock(mutex_);
    known_ = std::move(keys);
    known_at_ = at;
    return known_;
  } catch (const StateAway&) {
    // Vehicles are localized on while the state is away.
    const std::scoped_lock lock(mutex_);
    if (!known_) throw;
    return known_;
  }
}

void KeyTable::follow(const std::stop_token& stop) const {
  constexpr std::chrono::milliseconds kLookEvery(20), kTryAgain(500);
  const auto is_new = [&] {
    const std::scoped_lock lock(mutex_);
    return known_at_ != database_->told_mark();
  };
  while (!stop.stop_requested()) {
    std::this_thread::sleep_for(kLookEvery);
    if (!is_new()) continue;
    try {
      (void)read();
    } catch (const maps::StorageError&) {
      // The keys that are known count on; what watches PostgreSQL says that it is away.
    }
    if (is_new()) std::this_thread::sleep_for(kTryAgain);
  }
}

void KeyTable::note_change() {
  const std::scoped_lock lock(mutex_);
  needed_at_ = database_->told_mark().value_or(0);
}

}  // namespace stillmap::server
