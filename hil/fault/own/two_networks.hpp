#pragma once
#include <string>
#include <vector>

#include "common/process/children.hpp"

namespace ledgerline::hil {

/// Two networks with a cable between them: `sky`, with addresses of its own, and `client`, which reaches those and has
/// nothing else: a program there may bind any port. They are children that hold a network namespace each, and end with
/// `children`, which must outlive this. One thread.
class TwoNetworks {
 public:
  explicit TwoNetworks(Children& children) : children_(children) {}
  /// The error says what is missing: rights, or ip, unshare and nsenter.
  Status open(const std::vector<std::string>& sky_addresses, const std::string& directory);
  /// Words that start a command in one of them.
  std::vector<std::string> in_sky() const { return enter(sky); }
  std::vector<std::string> in_client() const { return enter(client); }

 private:
  static inline const std::string sky = "sky", client = "client";
  Status find_tools();
  Status hold(const std::string& name, const std::string& directory);
  Status set_up(const std::string& name, const std::string& lines, const std::string& directory);
  std::vector<std::string> enter(const std::string& name) const;
  std::string file_of(const std::string& name) const;

  Children& children_;
  std::string unshare_{}, nsenter_{}, sleep_{}, sh_{};  ///< where they are
};

}  // namespace ledgerline::hil
