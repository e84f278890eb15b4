#include "common/dds/domain.hpp"

#include <map>
#include <mutex>
#include <vector>

#include "common/base/log.hpp"
#include "common/dds/settings/this_host.hpp"

namespace ledgerline::dds {
namespace {

/// Collects what Cyclone says as long as it lives; one at a time.
class CycloneSays {
 public:
  CycloneSays() { dds_set_log_sink(&CycloneSays::take, this); }
  ~CycloneSays() { dds_set_log_sink(nullptr, nullptr); }
  CycloneSays(const CycloneSays&) = delete;
  CycloneSays& operator=(const CycloneSays&) = delete;

  std::vector<std::string> lines() const {
    const std::lock_guard lock(mutex_);
    return lines_;
  }
  std::string joined() const {
    std::string all;
    for (const std::string& line : lines()) all += (all.empty() ? "" : "; ") + line;
    return all;
  }

 private:
  static constexpr std::size_t max_lines = 32;
  static void take(void* self, const dds_log_data_t* data) {
    auto& says = *static_cast<CycloneSays*>(self);
    std::string line(data->message, data->size);
    while (!line.empty() && (line.back() == '\n' || line.back() == '\0')) line.pop_back();
    const std::lock_guard lock(says.mutex_);
    if (says.lines_.size() < max_lines) says.lines_.push_back(std::move(line));
  }

  mutable std::mutex mutex_;
  std::vector<std::string> lines_;
};

/// Null where the domain exists already by other means: it then keeps its own configuration.
Result<std::shared_ptr<OwnDomain>> own_domain(std::uint32_t id, const Reach& reach, const CycloneSays& says) {
  static std::map<std::uint32_t, std::weak_ptr<OwnDomain>> domains;
  if (auto existing = domains[id].lock()) return existing;
  const auto before = open_sockets();
  const dds_entity_t handle = dds_create_domain(id, reach.cyclone_config->c_str());
  if (handle == DDS_RETCODE_PRECONDITION_NOT_MET) return std::shared_ptr<OwnDomain>{};
  if (handle < 0) return Error{why_no_domain(id, says.joined())};
  auto made = std::make_shared<OwnDomain>(handle);
  if (reach.this_host_only) {
    if (auto heard = hear_this_host_only(id, before); !heard) return heard.error();
  }
  domains[id] = made;
  return made;
}

}  // namespace

Result<MadeParticipant> make_participant(std::uint32_t domain, const Reach& reach, const dds_qos_t* qos) {
  static std::mutex mutex;
  const std::lock_guard lock(mutex);
  const CycloneSays says;
  MadeParticipant made;
  if (reach.cyclone_config) {
    auto own = own_domain(domain, reach, says);
    if (!own) return own.error();
    made.domain = *own;
  }
  made.handle = dds_create_participant(domain, qos, nullptr);
  if (made.handle < 0) {
    const std::string said = says.joined();
    return Error{made.domain ? "no DDS participant in domain " + std::to_string(domain) + ": " +
                                   dds_strretcode(made.handle) + (said.empty() ? "" : ": " + said)
                             : why_no_domain(domain, said)};
  }
  for (const std::string& line : says.lines()) spdlog::warn("Cyclone DDS: {}", line);
  return made;
}

}  // namespace ledgerline::dds
