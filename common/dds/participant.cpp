#include <dds/dds.h>
#include <dds/security/dds_security_api_defs.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cstdlib>
#include <string>

#include "common/base/file.hpp"
#include "common/base/log.hpp"
#include "common/dds/dds.hpp"
#include "common/dds/domain.hpp"
#include "common/dds/endpoint.hpp"
#include "common/dds/node.hpp"

namespace ledgerline::dds {
namespace {

Result<std::uint32_t> domain_from_environment() {
  const char* text = std::getenv("ROS_DOMAIN_ID");
  if (!text || !*text) return std::uint32_t{0};
  const std::string digits = text;
  const bool plain =
      digits.size() <= 3 && std::all_of(digits.begin(), digits.end(), [](char c) { return c >= '0' && c <= '9'; });
  if (!plain || std::stoul(digits) > 232)
    return Error{"ROS_DOMAIN_ID is '" + digits + "': give a number from 0 to 232"};
  return static_cast<std::uint32_t>(std::stoul(digits));
}

Status check(const Security& files) {
  for (const std::string& path :
       {files.identity_ca, files.certificate, files.private_key, files.governance, files.permissions}) {
    if (::access(path.c_str(), R_OK) != 0) return Error{"DDS Security: cannot read '" + path + "'"};
  }
  struct stat info {};
  if (::stat(files.private_key.c_str(), &info) != 0 || !is_private(info))
    return Error{"DDS Security: " + files.private_key + " may be read by others than its owner; run: chmod 600 " +
                 files.private_key};
  return done;
}

void use(const Security& files, dds_qos_t* qos) {
  const auto plugin = [qos](const std::string& what, const std::string& library, const std::string& function) {
    const std::string key = DDS_SEC_PROP_PREFIX + what + ".library.";
    dds_qset_prop(qos, (key + "path").c_str(), (LEDGERLINE_DDS_PLUGINS "/libdds_security_" + library + ".so").c_str());
    dds_qset_prop(qos, (key + "init").c_str(), ("init_" + function).c_str());
    dds_qset_prop(qos, (key + "finalize").c_str(), ("finalize_" + function).c_str());
  };
  plugin("auth", "auth", "authentication");
  plugin("crypto", "crypto", "crypto");
  plugin("access", "ac", "access_control");
  const auto file = [qos](const char* key, const std::string& path) {
    dds_qset_prop(qos, key, ("file:" + path).c_str());
  };
  file(DDS_SEC_PROP_AUTH_IDENTITY_CA, files.identity_ca);
  file(DDS_SEC_PROP_AUTH_IDENTITY_CERT, files.certificate);
  file(DDS_SEC_PROP_AUTH_PRIV_KEY, files.private_key);
  file(DDS_SEC_PROP_ACCESS_PERMISSIONS_CA, files.identity_ca);
  file(DDS_SEC_PROP_ACCESS_GOVERNANCE, files.governance);
  file(DDS_SEC_PROP_ACCESS_PERMISSIONS, files.permissions);
}

}  // namespace

Result<ParticipantPtr> Participant::create(const ParticipantOptions& options) {
  std::uint32_t domain = 0;
  if (options.domain) {
    domain = *options.domain;
  } else {
    auto from_environment = domain_from_environment();
    if (!from_environment) return from_environment.error();
    domain = *from_environment;
  }

  if (!options.cyclonedds.empty() && ::access(options.cyclonedds.c_str(), R_OK) != 0)
    return Error{"DDS: cannot read '" + options.cyclonedds + "', which the config names for Cyclone DDS"};
  const char* uri = std::getenv("CYCLONEDDS_URI");
  const auto interfaces = host_interfaces();
  if (!interfaces) return interfaces.error();
  const auto reach = reach_of(options, uri ? uri : "", *interfaces);
  if (!reach) return reach.error();
  for (const std::string& warning : reach->warnings) spdlog::warn("{}", warning);
  const QosPtr qos(dds_create_qos());
  // How ROS 2 knows that a participant is one of its own.
  constexpr std::string_view enclave = "enclave=/;";
  if (!options.node.empty()) dds_qset_userdata(qos.get(), enclave.data(), enclave.size());
  if (options.security) {
    if (auto checked = check(*options.security); !checked) return checked.error();
    use(*options.security, qos.get());
  }
  const auto made = make_participant(domain, *reach, qos.get());
  if (!made) {
    return Error{made.error().message + (options.security ? " (with DDS Security: look at its files, too)" : "")};
  }
  // The participant goes before its domain.
  ParticipantPtr participant(new Participant(made->handle), [own = made->domain](const Participant* p) { delete p; });
  if (!options.node.empty()) {
    auto node = NodeInfo::create(made->handle, options.node, options.ros_release);
    if (!node) return node.error();
    participant->node_ = std::move(*node);
  }
  return participant;
}

Participant::Participant(int handle) : handle_(handle) {}

Participant::~Participant() {
  node_.reset();
  dds_delete(handle_);
}

}  // namespace ledgerline::dds
