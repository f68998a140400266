// A pose request in parts: the first line is its Content-Type, the rest the body.
#include "http/multipart.hpp"
#include "pose_rules.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace stillmap;
  std::string_view body = fuzz::text_of(data, size);
  const std::string_view type = fuzz::take_until(body, '\n');
  fuzz::read_and_require(type, body);
  const auto parts =
      fuzz::taken<server::ApiError>([&] { return server::split_multipart(type, body); });
  if (!parts) return 0;
  fuzz::require(parts->size() <= 4, "at most four parts");
  const char* from = body.data();
  for (const server::MultipartPart& part : *parts) {
    fuzz::require(!part.name.empty(), "a part has a name");
    fuzz::require(part.content.data() >= from &&
                      part.content.data() + part.content.size() <= body.data() + body.size(),
                  "parts lie in the body, one behind the other");
    from = part.content.data() + part.content.size();
  }
  return 0;
}
