#pragma once
#include <cstddef>
#include <initializer_list>
#include <nlohmann/json.hpp>
#include <string>
#include <string_view>

#include "ground/motion/waypoints.hpp"

/// JSON of clients, read strictly: what is not expected is refused, and the error says where. And how it is written.
/// Pure; any thread.
namespace ledgerline::ground::json {

inline constexpr std::size_t max_shown = 64;  ///< bytes of a client's word that is given back in an error

/// What is read at most: reading costs no more than this allows, whatever the bytes say.
struct Bounds {
  std::size_t max_bytes;
  int max_depth;             ///< of values: those of the outermost object are at depth 1
  std::size_t max_elements;  ///< values of any kind, lists and objects too
};

/// An object, or nothing at all, which is the empty one; within those bounds, no key of an object twice. Reading stops
/// at the first value too many. `what` the error is about: "the body".
Result<nlohmann::json> object_from(std::string_view text, std::string_view what, const Bounds& bounds);

/// The error names the first key that is not allowed.
Status only(const nlohmann::json& object, std::initializer_list<std::string_view> allowed);

/// {"x":1,"y":0,"z":1.2,"speed":0.5}, z and speed if they are there. What of it cannot be flown is for others to say.
Result<motion::Waypoint> waypoint_from(const nlohmann::json& given);

/// JSON text. Invalid UTF-8, which a drone's agent may have sent, is replaced instead of failing.
std::string dump(const nlohmann::json& value);

/// "hover" or "land": whether it lands behind a path.
Result<bool> land_behind_from(const nlohmann::json& then);

}  // namespace ledgerline::ground::json
