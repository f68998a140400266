#include "json/request_json.hpp"

#include "errors/api_error.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <utility>
#include <vector>

namespace stillmap::server {
namespace {

using RequestJson = nlohmann::json;

/// Deepest nesting of any request is 3.
constexpr std::size_t kMaxDepth = 8;

/// Builds a request value by value, so that bounds hold while it is read. `json::parse` with a
/// callback does not: after each object it looks at all that its parent has (nlohmann 3.11.2), and
/// so n objects in an array take n² steps.
class RequestReader final : public RequestJson::json_sax_t {
 public:
  explicit RequestReader(std::size_t max_values) : max_values_(max_values) {}

  [[nodiscard]] RequestJson take() { return std::move(root_); }

  bool null() override { return add(nullptr); }
  bool boolean(bool value) override { return add(value); }
  bool number_integer(number_integer_t value) override { return add(value); }
  bool number_unsigned(number_unsigned_t value) override { return add(value); }
  bool number_float(number_float_t value, const string_t& /*text*/) override { return add(value); }
  bool string(string_t& value) override { return add(std::move(value)); }
  bool binary(binary_t& /*value*/) override { return false; }

  bool start_object(std::size_t /*unknown*/) override { return open(RequestJson::object()); }
  bool end_object() override { return close(); }
  bool start_array(std::size_t /*unknown*/) override { return open(RequestJson::array()); }
  bool end_array() override { return close(); }

  bool key(string_t& name) override {
    const auto [place, is_new] = open_.back()->get_ref<RequestJson::object_t&>().try_emplace(name);
    if (!is_new) throw field_error(ErrorCode::kInvalidRequest, name, "the key twice", "it once");
    at_key_ = &place->second;
    return true;
  }

  bool parse_error(std::size_t /*at*/, const std::string& /*token*/,
                   const RequestJson::exception& error) override {
    // Its message is "[json.exception...] parse error at line 1, column 8: ...".
    throw ApiError(ErrorCode::kInvalidRequest, std::string("JSON: ") + error.what());
  }

 private:
  RequestJson& place_of(RequestJson value) {
    if (++values_ > max_values_)
      throw field_error(ErrorCode::kPayloadTooLarge, "JSON", "more values",
                        fmt::format("at most {}", max_values_));
    if (open_.empty()) return root_ = std::move(value);
    if (open_.back()->is_object()) return *at_key_ = std::move(value);
    return open_.back()->get_ref<RequestJson::array_t&>().emplace_back(std::move(value));
  }

  bool add(RequestJson value) {
    place_of(std::move(value));
    return true;
  }

  bool open(RequestJson empty) {
    if (open_.size() == kMaxDepth)
      throw field_error(ErrorCode::kInvalidRequest, "JSON", "deep nesting",
                        fmt::format("at most {}", kMaxDepth));
    open_.push_back(&place_of(std::move(empty)));
    return true;
  }

  bool close() {
    open_.pop_back();
    return true;
  }

  std::size_t max_values_;
  std::size_t values_ = 0;
  RequestJson root_;
  /// Arrays and objects that have not ended, the outermost first. Nothing is added to one while one
  /// inside it is open, so they stay where they are.
  std::vector<RequestJson*> open_;
  RequestJson* at_key_ = nullptr;
};

}  // namespace

RequestJson parse_request_json(std::string_view text, std::size_t max_bytes,
                               std::size_t max_values) {
  if (text.size() > max_bytes) {
    throw field_error(ErrorCode::kPayloadTooLarge, "JSON", fmt::format("{} bytes", text.size()),
                      fmt::format("at most {}", max_bytes));
  }
  RequestReader reader(max_values);
  RequestJson::sax_parse(text, &reader);
  return reader.take();
}

void refuse(const std::string& path, const RequestJson& found, const std::string& expected) {
  std::string text = found.dump(-1, ' ', true, RequestJson::error_handler_t::replace);
  if (text.size() > 80) text = text.substr(0, 80) + "...";
  throw field_error(ErrorCode::kInvalidRequest, path, text, expected);
}

void require_keys(const RequestJson& object, const std::string& path,
                  std::span<const std::string_view> known) {
  if (!object.is_object()) refuse(path.empty() ? "JSON" : path, object, "an object");
  std::string names;
  for (const std::string_view name : known)
    names += (names.empty() ? "" : ", ") + std::string(name);
  for (const auto& item : object.items()) {
    if (std::find(known.begin(), known.end(), item.key()) != known.end()) continue;
    throw field_error(ErrorCode::kUnknownParameter,
                      path.empty() ? item.key() : path + "." + item.key(), "an unknown key", names);
  }
}

void require_keys(const RequestJson& object, const std::string& path,
                  std::initializer_list<std::string_view> known) {
  require_keys(object, path, std::span(known.begin(), known.size()));
}

}  // namespace stillmap::server
