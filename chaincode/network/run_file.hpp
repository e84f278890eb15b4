#pragma once
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>

namespace ledgerline::fabric_network {

/// DIR/network.json: held (flock) by the network's process as long as it lives, however it ends; its text is what
/// `status` shows. One thread.
class RunFile {
 public:
  explicit RunFile(const std::string& dir) : path_(dir + "/network.json") {}
  ~RunFile();
  RunFile(const RunFile&) = delete;
  RunFile& operator=(const RunFile&) = delete;

  /// False: another process holds it.
  bool take();
  bool write(const std::string& text) const;
  /// What a living network says of itself, an empty object while it starts; nullopt: none runs.
  std::optional<nlohmann::json> read() const;

 private:
  std::string path_;
  int fd_ = -1;
};

}  // namespace ledgerline::fabric_network
