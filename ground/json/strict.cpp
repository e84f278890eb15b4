#include "ground/json/strict.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <utility>
#include <vector>

#include "common/base/text.hpp"

namespace ledgerline::ground::json {
namespace {

using Json = nlohmann::json;

/// Builds a value as it is read, and stops at the first thing too many. The library's own way to look on while it
/// builds, a callback, goes through a list once for each object in it.
class Builder final : public nlohmann::json_sax<Json> {
 public:
  explicit Builder(const Bounds& bounds) : bounds_(bounds) {}

  enum class Fault { none, malformed, too_deep, too_many };
  Fault fault() const { return fault_; }
  const std::string& twice() const { return twice_; }  ///< a key of an object that has it twice; empty: none
  Json& built() { return root_; }

  bool null() override { return add(nullptr) != nullptr; }
  bool boolean(bool value) override { return add(value) != nullptr; }
  bool number_integer(number_integer_t value) override { return add(value) != nullptr; }
  bool number_unsigned(number_unsigned_t value) override { return add(value) != nullptr; }
  bool number_float(number_float_t value, const string_t&) override { return add(value) != nullptr; }
  bool string(string_t& value) override { return add(std::move(value)) != nullptr; }
  bool binary(binary_t&) override { return stop(Fault::malformed); }
  bool start_object(std::size_t) override { return open(Json::object()); }
  bool start_array(std::size_t) override { return open(Json::array()); }
  bool end_object() override { return close(); }
  bool end_array() override { return close(); }
  bool key(string_t& name) override {
    if (open_.back()->contains(name)) twice_ = name;
    key_ = std::move(name);
    return true;
  }
  bool parse_error(std::size_t, const std::string&, const nlohmann::detail::exception&) override {
    return stop(Fault::malformed);
  }

 private:
  bool stop(Fault why) {
    fault_ = why;
    return false;
  }
  /// Where it stands now; null: it is one too many.
  Json* add(Json value) {
    if (static_cast<int>(open_.size()) > bounds_.max_depth) return stop(Fault::too_deep), nullptr;
    if (++elements_ > bounds_.max_elements) return stop(Fault::too_many), nullptr;
    if (open_.empty()) return &(root_ = std::move(value));
    Json& inside = *open_.back();
    if (inside.is_object()) return &(inside[key_] = std::move(value));
    inside.push_back(std::move(value));
    return &inside.back();
  }
  bool open(Json empty) {
    Json* const opened = add(std::move(empty));
    if (opened) open_.push_back(opened);
    return opened != nullptr;
  }
  bool close() {
    open_.pop_back();
    return true;
  }

  const Bounds bounds_;
  Json root_;
  std::vector<Json*> open_;  ///< from the outermost; none of them moves while it is open
  std::string key_, twice_;
  std::size_t elements_ = 0;
  Fault fault_ = Fault::none;
};

}  // namespace

Result<Json> object_from(std::string_view text, std::string_view what, const Bounds& bounds) {
  if (text.empty()) return Json::object();
  if (text.size() > bounds.max_bytes)
    return Error{fmt::format("{} has {} bytes; {} may be", what, text.size(), bounds.max_bytes)};
  Builder builder(bounds);
  const bool whole = Json::sax_parse(text, &builder);
  if (builder.fault() == Builder::Fault::too_many)
    return Error{fmt::format("{} has more than {} values", what, bounds.max_elements)};
  if (!whole || !builder.built().is_object())
    return Error{fmt::format("{} must be a JSON object that nests at most {} deep", what, bounds.max_depth)};
  if (!builder.twice().empty())
    return Error{fmt::format("{} has the key \"{}\" twice", what, printable(builder.twice(), max_shown))};
  return std::move(builder.built());
}

Status only(const Json& object, std::initializer_list<std::string_view> allowed) {
  for (const auto& [key, value] : object.items()) {
    if (std::ranges::find(allowed, key) == allowed.end())
      return Error{"unknown key \"" + printable(key, max_shown) + "\""};
  }
  return done;
}

Result<motion::Waypoint> waypoint_from(const Json& given) {
  if (!given.is_object()) return Error{"must be an object"};
  if (const Status keys = only(given, {"x", "y", "z", "speed"}); !keys) return keys.error();
  for (const auto& [key, value] : given.items()) {
    if (!value.is_number()) return Error{key + " must be a number"};
  }
  if (!given.contains("x") || !given.contains("y")) return Error{"needs x and y"};
  motion::Waypoint waypoint;
  waypoint.at_m = {given["x"].get<double>(), given["y"].get<double>()};
  if (given.contains("z")) waypoint.height_m = given["z"].get<double>();
  if (given.contains("speed")) waypoint.speed_mps = given["speed"].get<double>();
  return waypoint;
}

std::string dump(const Json& value) { return value.dump(-1, ' ', false, Json::error_handler_t::replace); }

Result<bool> land_behind_from(const Json& then) {
  if (then != "hover" && then != "land") return Error{R"(then must be "hover" or "land")"};
  return then == "land";
}

}  // namespace ledgerline::ground::json
