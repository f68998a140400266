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

/// For a message.
std::string excerpt_of(const RequestJson& found) {
  std::string text = found.dump(-1, ' ', true, RequestJson::error_handler_t::replace);
  if (text.size() > 80) text = text.substr(0, 80) + "...";
  return text;
}

/// How often a reader looks whether it is still wanted [values].
constexpr std::size_t kLookEvery = 4096;

/// The list of points that is being read: `[[x, y, z], ...]`.
class PointListReader {
 public:
  PointListReader(JsonPoints& list, std::size_t max_points)
      : list_(list), max_points_(max_points) {}

  /// Arrays and objects that are open, the list included; 0 = it has ended.
  [[nodiscard]] std::size_t depth() const { return depth_; }

  void number(double value) {
    if (depth_ != 2 || is_object_ || count_ == 3) return fail_point();
    p_[static_cast<Eigen::Index>(count_++)] = static_cast<float>(value);
  }
  void other() { fail_point(); }
  void open(bool object) {
    if (++depth_ != 2) return fail_point();
    is_object_ = object;
    count_ = 0;
    if (points_ < max_points_ || list_.error) return;
    fail(field_error(ErrorCode::kPayloadTooLarge, "points", "more points",
                     fmt::format("at most {}", max_points_)));
  }
  void close() {
    if (--depth_ != 1) return;
    if (is_object_ || count_ != 3) fail_point();
    ++points_;
    if (!list_.error && p_ != Eigen::Vector3f::Zero()) list_.positions.push_back(p_);
  }

 private:
  void fail_point() {
    if (list_.error) return;
    fail(field_error(ErrorCode::kInvalidRequest, fmt::format("points[{}]", points_),
                     "something else", "[x, y, z]"));
  }
  void fail(ApiError error) {
    list_.error = std::move(error);
    list_.positions = {};
  }

  JsonPoints& list_;
  std::size_t max_points_;
  std::size_t depth_ = 1;
  std::size_t points_ = 0;
  /// Of the point that is being read.
  bool is_object_ = false;
  std::size_t count_ = 0;
  Eigen::Vector3f p_;
};

/// Builds a request value by value, so that bounds hold while it is read. `json::parse` with a
/// callback does not: after each object it looks at all that its parent has (nlohmann 3.11.2), and
/// so n objects in an array take n² steps. Not maps::parse_json: that one reads all of the text
/// first.
class RequestReader final : public RequestJson::json_sax_t {
 public:
  /// @param points_depth  0 = no key is a list of points.
  explicit RequestReader(const JsonBounds& bounds, std::size_t points_depth = 0,
                         std::size_t max_points = 0)
      : bounds_(bounds), points_depth_(points_depth), max_points_(max_points) {}

  [[nodiscard]] JsonWithPoints take() { return {std::move(root_), std::move(lists_)}; }

  bool null() override { return add(nullptr); }
  bool boolean(bool value) override { return add(value); }
  bool number_integer(number_integer_t value) override { return add_number(value); }
  bool number_unsigned(number_unsigned_t value) override { return add_number(value); }
  bool number_float(number_float_t value, const string_t& /*text*/) override {
    return add_number(value);
  }
  bool string(string_t& value) override { return add(std::move(value)); }
  bool binary(binary_t& /*value*/) override { return false; }

  bool start_object(std::size_t /*unknown*/) override { return open(RequestJson::object()); }
  bool end_object() override { return close(); }
  bool start_array(std::size_t /*unknown*/) override { return open(RequestJson::array()); }
  bool end_array() override { return close(); }

  bool key(string_t& name) override {
    if (points_) return true;  // of an object in a list of points, which is refused already
    const auto [place, is_new] = open_.back()->get_ref<RequestJson::object_t&>().try_emplace(name);
    if (!is_new) throw field_error(ErrorCode::kInvalidRequest, name, "the key twice", "it once");
    at_key_ = &place->second;
    points_next_ = open_.size() == points_depth_ && name == "points";
    return true;
  }

  bool parse_error(std::size_t /*at*/, const std::string& /*token*/,
                   const RequestJson::exception& error) override {
    // Its message is "[json.exception...] parse error at line 1, column 8: ...".
    throw ApiError(ErrorCode::kInvalidRequest, std::string("JSON: ") + error.what());
  }

 private:
  RequestJson& place_of(RequestJson value) {
    if (++values_ > bounds_.max_values)
      throw field_error(ErrorCode::kPayloadTooLarge, "JSON", "more values",
                        fmt::format("at most {}", bounds_.max_values));
    if (open_.empty()) return root_ = std::move(value);
    if (open_.back()->is_object()) return *at_key_ = std::move(value);
    return open_.back()->get_ref<RequestJson::array_t&>().emplace_back(std::move(value));
  }

  bool add(RequestJson value) {
    look_whether_wanted();
    if (points_) {
      points_->other();
    } else if (points_next_) {
      add_list().error = no_list(value);
    } else {
      place_of(std::move(value));
    }
    return true;
  }

  template <typename Number>
  bool add_number(Number value) {
    if (!points_) return add(RequestJson(value));
    look_whether_wanted();
    points_->number(static_cast<double>(value));
    return true;
  }

  bool open(RequestJson empty) {
    look_whether_wanted();
    if (open_.size() + (points_ ? points_->depth() : 0) == kMaxDepth)
      throw field_error(ErrorCode::kInvalidRequest, "JSON", "deep nesting",
                        fmt::format("at most {}", kMaxDepth));
    if (points_) {
      points_->open(empty.is_object());
    } else if (points_next_) {
      JsonPoints& list = add_list();
      if (empty.is_object()) list.error = no_list(empty);
      points_.emplace(list, max_points_);
    } else {
      open_.push_back(&place_of(std::move(empty)));
    }
    return true;
  }

  bool close() {
    if (!points_) {
      open_.pop_back();
      return true;
    }
    points_->close();
    if (points_->depth() == 0) points_.reset();
    return true;
  }

  JsonPoints& add_list() {
    points_next_ = false;
    place_of(lists_.size());
    return lists_.emplace_back();
  }
  static ApiError no_list(const RequestJson& found) {
    return field_error(ErrorCode::kInvalidRequest, "points", excerpt_of(found), "an array");
  }

  void look_whether_wanted() {
    if (++seen_ % kLookEvery == 0 && bounds_.require_wanted) bounds_.require_wanted();
  }

  const JsonBounds& bounds_;
  std::size_t points_depth_;
  std::size_t max_points_;
  std::size_t values_ = 0;
  /// Also those that are in lists of points, which are no JSON values.
  std::size_t seen_ = 0;
  RequestJson root_;
  std::vector<JsonPoints> lists_;
  /// Arrays and objects that have not ended, the outermost first. Nothing is added to one while one
  /// inside it is open, so they stay where they are.
  std::vector<RequestJson*> open_;
  RequestJson* at_key_ = nullptr;
  /// The next value is that of a key `points`.
  bool points_next_ = false;
  std::optional<PointListReader> points_;
};

void require_size(std::string_view text, std::size_t max_bytes) {
  if (text.size() <= max_bytes) return;
  throw field_error(ErrorCode::kPayloadTooLarge, "JSON", fmt::format("{} bytes", text.size()),
                    fmt::format("at most {}", max_bytes));
}

}  // namespace

RequestJson parse_request_json(std::string_view text, const JsonBounds& bounds) {
  require_size(text, bounds.max_bytes);
  RequestReader reader(bounds);
  RequestJson::sax_parse(text, &reader);
  return reader.take().json;
}

JsonWithPoints parse_json_with_points(std::string_view text, const JsonBounds& bounds,
                                      std::size_t depth, std::size_t max_points) {
  require_size(text, bounds.max_bytes);
  RequestReader reader(bounds, depth, max_points);
  RequestJson::sax_parse(text, &reader);
  return reader.take();
}

void refuse(const std::string& path, const RequestJson& found, const std::string& expected) {
  throw field_error(ErrorCode::kInvalidRequest, path, excerpt_of(found), expected);
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
