#pragma once
#include <optional>
#include <string>
#include <string_view>

namespace ledgerline::fabric {

/// The contract's own refusal: a retry would be refused again. Whatever else refuses a call (a peer, a relay, an
/// orderer) gives none, and may let the next one pass. Made once, with the outcome; nobody else reads an outcome's
/// message.
struct Refusal {
  std::string about;  ///< the id or drone that the words begin with ("tello3: ..."); empty: the whole call
  std::string words;  ///< the contract's, without what the peer puts before them
};

/// Of the message with which a peer refused a call; none: that was not the contract.
inline std::optional<Refusal> refusal_in(std::string_view message) {
  constexpr std::string_view introduction = "chaincode response 500, ";
  if (!message.starts_with(introduction)) return std::nullopt;
  message.remove_prefix(introduction.size());
  // What a peer of Fabric answers in the contract's stead when it cannot run it.
  if (message.starts_with("error in simulation")) return std::nullopt;
  // The contract of another version, on a channel that is being moved: the next one may know the function.
  if (message.starts_with("unknown function ")) return std::nullopt;
  const auto colon = message.find(':');  // no id has one
  return Refusal{std::string(message.substr(0, colon == std::string_view::npos ? 0 : colon)), std::string(message)};
}

/// The refusal is for this id alone, or for the drone or name that it is below: the rest of the call may go again.
inline bool names(const Refusal& refusal, std::string_view id) {
  return !refusal.about.empty() && (refusal.about == id || refusal.about == id.substr(0, id.find('/')));
}

}  // namespace ledgerline::fabric
