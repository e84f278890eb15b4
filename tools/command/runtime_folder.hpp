#pragma once
#include <string>

namespace ledgerline {

/// Of a user, for what a log-out or a restart may remove: $XDG_RUNTIME_DIR/ledgerline, else ~/.cache/ledgerline; empty:
/// there is neither. Session files are in it, and flight_link.
inline std::string runtime_folder(const std::string& xdg_runtime_dir, const std::string& home) {
  if (!xdg_runtime_dir.empty()) return xdg_runtime_dir + "/ledgerline";
  return home.empty() ? "" : home + "/.cache/ledgerline";
}

/// While `ledgerline fly --watch` flies: a link to the config of its ground.
inline constexpr const char* flight_link = "flight.toml";

}  // namespace ledgerline
