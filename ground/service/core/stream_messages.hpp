#pragma once
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/result.hpp"
#include "ground/service/core/api.hpp"

/// What clients say on the stream, and what they are answered. Pure; any thread.
namespace ledgerline::ground::service {

/// {"op":"velocity","drone":"tello1","linear":[x,y,z],"yaw_rate":r,"t_ms":T}. `t_ms` is that of the newest state which
/// its pilot had: older than max_held_ns, a network has held it back, and it is late. The error says what is wrong with
/// it.
inline constexpr TimeNs max_held_ns = 500 * ns_per_ms;
Result<PilotCommand> command_from(std::string_view message, const std::vector<std::string>& names, TimeNs now);

/// Who has opened the stream.
struct StreamClient {
  std::optional<std::size_t> who{};  ///< the operator, while his session lasts
  bool session_ended = false;        ///< as in ApiRequest
};
/// stop, land and cut, which an open stream takes when no other connection can be had.
struct StreamCommand {
  ApiAnswer made;                     ///< as the request of the same meaning has it
  std::optional<std::uint64_t> id{};  ///< the client's own, for the answer
};
struct StreamMessage {
  std::optional<PilotCommand> velocity{};
  std::optional<StreamCommand> command{};
};
/// {"op":"stop"} of all drones, {"op":"stop","drone":"tello1"}; the same of "cut", which may say "confirmed":true;
/// "land" of a drone; each may have an "id"; or a velocity. The error: it is none of these.
Result<StreamMessage> read_stream_message(std::string_view message, const StreamClient& client, const ApiContext& known,
                                          TimeNs now);

/// {"op":"answer","id":7,"status":202}, with the "error" where it is refused.
std::string answer_message(std::uint64_t id, const ApiAnswer& answer);

}  // namespace ledgerline::ground::service
