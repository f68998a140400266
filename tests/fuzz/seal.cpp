// The text of a seal that is given to the server, and what a sealed session may hold: the first
// line is the text, the next two are version and vehicle, the rest is the tracker's state.
#include "sealing/seal.hpp"
#include "fuzz_target.hpp"
#include "http/base64.hpp"

#include <stdexcept>

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace stillmap;
  static const server::SealKey key = server::SealKey::from_hex(std::string(64, '7')).value();
  const server::SealOwner owner{.key_id = "0123456789abcdef", .map = "town"};
  std::string_view text = fuzz::text_of(data, size);
  const std::string_view given = fuzz::take_until(text, '\n');
  if (const auto bytes = server::from_base64(given))
    fuzz::require(server::to_base64(*bytes) == given, "one text for the same bytes");
  fuzz::require(!server::open_seal(given, owner, key), "no seal is guessed");

  server::SealedSession session;
  session.id = "0123456789abcdef";
  session.digest = std::string(64, 'd');
  session.count = size;
  session.version = fuzz::take_until(text, '\n');
  session.vehicle = fuzz::take_until(text, '\n');
  session.tracker = text;
  const auto sealed =
      fuzz::taken<std::invalid_argument>([&] { return server::seal(session, owner, key); });
  if (!sealed) return 0;
  fuzz::require(sealed->size() <= server::kMaxSealText, "seals are bounded");
  const auto opened = server::open_seal(*sealed, owner, key);
  fuzz::require(opened && opened->version == session.version &&
                    opened->vehicle == session.vehicle && opened->tracker == session.tracker &&
                    opened->count == session.count && opened->digest == session.digest,
                "what was sealed is opened");
  std::string changed = *sealed;
  char& letter = changed[size % changed.size()];
  letter = letter == 'A' ? 'B' : 'A';
  fuzz::require(!server::open_seal(changed, owner, key), "a change is noticed");
  return 0;
}
