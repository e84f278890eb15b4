#include "ground/service/core/stream_messages.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <array>
#include <cmath>
#include <nlohmann/json.hpp>
#include <utility>

#include "ground/json/strict.hpp"

namespace ledgerline::ground::service {
namespace {

using ground::json::only;
using nlohmann::json;

constexpr ground::json::Bounds message_bounds{4096, 2, 16};  // a velocity has nine values

Result<json> message_from(std::string_view message) {
  return ground::json::object_from(message, "the message", message_bounds);
}

/// Three numbers, or an error.
Result<std::array<double, 3>> triple(const json& value, const char* what) {
  std::array<double, 3> numbers{};
  const bool three = value.is_array() && value.size() == numbers.size() &&
                     std::ranges::all_of(value, [](const json& n) { return n.is_number(); });
  if (!three) return Error{std::string(what) + " must be three numbers"};
  for (std::size_t i = 0; i < numbers.size(); ++i) numbers[i] = value[i].get<double>();
  return numbers;
}

std::optional<std::size_t> drone_in(const json& said, const std::vector<std::string>& names) {
  const json name = said.value("drone", json());
  return name.is_string() ? drone_of(names, name.get_ref<const std::string&>()) : std::nullopt;
}

Result<PilotCommand> velocity_from(const json& said, const std::vector<std::string>& names, TimeNs now) {
  if (const Status keys = only(said, {"op", "drone", "linear", "yaw_rate", "t_ms"}); !keys) return keys.error();
  if (said.value("op", json()) != "velocity") return Error{R"(op must be "velocity")"};
  const auto drone = drone_in(said, names);
  if (!drone) return Error{"drone must be one that flies here"};
  const auto linear = triple(said.value("linear", json()), "linear");
  if (!linear) return linear.error();
  const json yaw_rate = said.value("yaw_rate", json());
  if (!yaw_rate.is_number()) return Error{"yaw_rate must be a number"};
  const json t_ms = said.value("t_ms", json());
  constexpr double rounded_ms = 1;
  if (!t_ms.is_number() || !(std::abs(t_ms.get<double>()) <= to_ms(now) + rounded_ms))
    return Error{"t_ms must be that of the newest state that its pilot had"};
  if (to_ms(now) - t_ms.get<double>() > to_ms(max_held_ns)) return PilotCommand{.drone = *drone, .late = 1};
  return PilotCommand{.drone = *drone, .velocity = Twist{*linear, {0, 0, yaw_rate.get<double>()}}, .came_ns = now};
}

/// Who may say it is decided where requests are answered, for both ways.
Result<StreamCommand> command_from(const json& said, const std::string& op, const StreamClient& client,
                                   const ApiContext& known) {
  if (const Status keys = only(said, {"op", "drone", "id", "confirmed"}); !keys) return keys.error();
  StreamCommand command;
  const json id = said.value("id", json());
  if (!id.is_null() && !id.is_number_unsigned()) return Error{"id must be a number from 0"};
  if (!id.is_null()) command.id = id.get<std::uint64_t>();
  json body = json::object();
  if (said.contains("confirmed")) body["confirmed"] = said["confirmed"];
  std::string target = "/api/v1/stop";
  if (said.contains("drone") || op == "land") {
    const auto drone = drone_in(said, known.names);
    if (!drone) return Error{"drone must be one that flies here"};
    target = fmt::format("/api/v1/drones/{}/{}", known.names[*drone], op);
  } else if (op == "cut") {
    body["cut"] = true;
  }
  const std::string text = body.dump();
  command.made = answer(
      {.method = "POST", .target = target, .body = text, .who = client.who, .session_ended = client.session_ended},
      known);
  return command;
}

}  // namespace

Result<PilotCommand> command_from(std::string_view message, const std::vector<std::string>& names, TimeNs now) {
  const auto said = message_from(message);
  if (!said) return said.error();
  return velocity_from(*said, names, now);
}

Result<StreamMessage> read_stream_message(std::string_view message, const StreamClient& client, const ApiContext& known,
                                          TimeNs now) {
  const auto said = message_from(message);
  if (!said) return said.error();
  const json op = said->value("op", json());
  StreamMessage read;
  if (op == "stop" || op == "land" || op == "cut") {
    auto command = command_from(*said, op.get<std::string>(), client, known);
    if (!command) return command.error();
    read.command = std::move(*command);
    return read;
  }
  if (op != "velocity") return Error{R"(op must be "velocity", "stop", "land" or "cut")"};
  auto velocity = velocity_from(*said, known.names, now);
  if (!velocity) return velocity.error();
  read.velocity = std::move(*velocity);
  return read;
}

std::string answer_message(std::uint64_t id, const ApiAnswer& answer) {
  json message{{"op", "answer"}, {"id", id}, {"status", answer.status}};
  const json body = json::parse(answer.body, nullptr, false);
  if (body.is_object() && body.contains("error")) message["error"] = body["error"];
  return ground::json::dump(message);
}

}  // namespace ledgerline::ground::service
