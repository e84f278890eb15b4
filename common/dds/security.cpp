#include "common/dds/dds.hpp"

#include <fmt/chrono.h>
#include <fmt/format.h>

#include <map>
#include <utility>

#include "common/base/text.hpp"

namespace ledgerline::dds {
namespace {

// DDS Security 1.1, 9.4.1.2. Names and payloads are encrypted; the messages around them are signed.
constexpr const char* governance = R"(<?xml version="1.0" encoding="UTF-8"?>
<dds xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance"
     xsi:noNamespaceSchemaLocation="http://www.omg.org/spec/DDS-SECURITY/20170901/omg_shared_ca_governance.xsd">
  <domain_access_rules>
    <domain_rule>
      <domains><id_range><min>0</min><max>230</max></id_range></domains>
      <allow_unauthenticated_participants>false</allow_unauthenticated_participants>
      <enable_join_access_control>true</enable_join_access_control>
      <discovery_protection_kind>ENCRYPT</discovery_protection_kind>
      <liveliness_protection_kind>ENCRYPT</liveliness_protection_kind>
      <rtps_protection_kind>SIGN</rtps_protection_kind>
      <topic_access_rules>
        <topic_rule>
          <topic_expression>*</topic_expression>
          <enable_discovery_protection>true</enable_discovery_protection>
          <enable_liveliness_protection>true</enable_liveliness_protection>
          <enable_read_access_control>true</enable_read_access_control>
          <enable_write_access_control>true</enable_write_access_control>
          <metadata_protection_kind>ENCRYPT</metadata_protection_kind>
          <data_protection_kind>ENCRYPT</data_protection_kind>
        </topic_rule>
      </topic_access_rules>
    </domain_rule>
  </domain_access_rules>
</dds>
)";

// Rules are looked through in their order, and the first that names the topic decides. Reading comes first: Cyclone
// looks for either direction when a topic is made, and what must not be written could not be read behind its rule.
constexpr const char* grant = R"(
    <grant name="member{}">
      <subject_name>{}</subject_name>
      <validity><not_before>{}</not_before><not_after>{}</not_after></validity>
      <allow_rule>
        <domains><id_range><min>0</min><max>230</max></id_range></domains>
        <subscribe><topics><topic>*</topic></topics></subscribe>
      </allow_rule>{}
      <allow_rule>
        <domains><id_range><min>0</min><max>230</max></id_range></domains>
        <publish><topics>{}</topics></publish>
      </allow_rule>
      <default>DENY</default>
    </grant>)";

constexpr const char* publish_denied = R"(
      <deny_rule>
        <domains><id_range><min>0</min><max>230</max></id_range></domains>
        <publish><topics>{}</topics></publish>
      </deny_rule>)";

using Topics = std::vector<std::string>;

/// As they are on the wire (ground/core/topics.cpp); a drone's name has no slash.
const Topics pilot_topics{"rt/*/cmd_vel", "rt/*/takeoff", "rt/*/land", "rt/*/stop", "rt/*/emergency"};
/// Of any node of ROS 2: its discovery, log, and the services for its parameters.
const Topics node_topics{"ros_discovery_info", "rt/rosout", "rt/parameter_events", "rq/*", "rr/*"};

std::string topics_text(const Topics& topics) {
  std::string text;
  for (const std::string& topic : topics) text += "<topic>" + xml_text(topic) + "</topic>";
  return text;
}

struct Member {
  bool is_program = false, is_pilot = false, is_tracker = false;
};

/// What a member may write: the rules before the last one, and the topics of that.
std::pair<std::string, Topics> publish_rules(const Member& member, const std::string& poses) {
  const Topics pose_topics{poses};
  Topics own, others;
  const auto sort = [&](bool may, const Topics& topics) {
    Topics& list = may ? own : others;
    list.insert(list.end(), topics.begin(), topics.end());
  };
  sort(member.is_pilot, pilot_topics);
  sort(member.is_tracker, pose_topics);
  if (!member.is_program) {
    own.insert(own.end(), node_topics.begin(), node_topics.end());
    return {"", own};
  }
  return {others.empty() ? "" : fmt::format(publish_denied, topics_text(others)), {"*"}};
}

std::string permissions(const std::string& grants) {
  return R"(<?xml version="1.0" encoding="UTF-8"?>
<dds xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance"
     xsi:noNamespaceSchemaLocation="http://www.omg.org/spec/DDS-SECURITY/20170901/omg_shared_ca_permissions.xsd">
  <permissions>)" +
         grants + "\n  </permissions>\n</dds>\n";
}

std::string date(std::int64_t unix_s) { return fmt::format("{:%Y-%m-%dT%H:%M:%S}", fmt::gmtime(unix_s)); }

}  // namespace

Result<SecurityDocuments> make_security_documents(const crypto::KeyAndCertificate& authority,
                                                  const SecurityMembers& members) {
  auto signer_pem = crypto::make_document_authority(authority);
  if (!signer_pem) return signer_pem.error();
  const crypto::KeyAndCertificate signer{authority.key_pem, *signer_pem};
  const auto own = crypto::parse_certificate(*signer_pem);
  if (!own) return own.error();
  if (members.poses.empty() || members.poses.front() != '/')
    return Error{fmt::format("the topics with poses must begin with a slash, as \"/vrpn_mocap/*\"; not \"{}\"",
                             printable(members.poses))};
  std::map<std::string, Member> by_subject;
  for (const auto& [list, is] :
       {std::pair(&members.programs, &Member::is_program), std::pair(&members.pilots, &Member::is_pilot),
        std::pair(&members.trackers, &Member::is_tracker)}) {
    for (const std::string& pem : *list) {
      const auto certificate = crypto::parse_certificate(pem);
      if (!certificate) return certificate.error();
      if (const auto issued = crypto::check_issued_by(*signer_pem, pem); !issued)
        return Error{fmt::format("{}: {}, so DDS Security would not let it in", printable(certificate->subject),
                                 issued.error().message)};
      by_subject[certificate->subject].*is = true;
    }
  }
  std::string grants;
  std::size_t number = 0;
  for (const auto& [subject, member] : by_subject) {
    const auto& [denied, topics] = publish_rules(member, "rt" + members.poses);
    grants += fmt::format(grant, ++number, xml_text(subject), date(own->not_before_s), date(own->not_after_s), denied,
                          topics_text(topics));
  }
  auto signed_governance = crypto::sign_document(signer, governance);
  if (!signed_governance) return signed_governance.error();
  auto signed_permissions = crypto::sign_document(signer, permissions(grants));
  if (!signed_permissions) return signed_permissions.error();
  return SecurityDocuments{*signer_pem, std::move(*signed_governance), std::move(*signed_permissions)};
}

}  // namespace ledgerline::dds
