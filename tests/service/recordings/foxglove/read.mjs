// Read an MCAP file with Foxglove's own packages; print a line of JSON: messages and fields of each topic.
import { readFile } from "node:fs/promises";
import { createRequire } from "node:module";

// The packages stand where npm put them, not beside this file.
const require = createRequire(`${process.argv[3]}/package.json`);
const { McapIndexedReader } = require("@mcap/core");
const { loadDecompressHandlers } = require("@mcap/support");
const { protobufFromBinaryDescriptor } = require("@mcap/support");
const { foxgloveMessageSchemas } = require("@foxglove/schemas/internal");

const data = new Uint8Array(await readFile(process.argv[2]));
const readable = {
  size: async () => BigInt(data.length),
  read: async (offset, size) => data.subarray(Number(offset), Number(offset + size)),
};
const decompressHandlers = await loadDecompressHandlers();
const reader = await McapIndexedReader.Initialize({ readable, decompressHandlers });

function decoder(schema) {
  if (schema.encoding === "jsonschema") {
    const { properties } = JSON.parse(new TextDecoder().decode(schema.data));
    return (bytes) => {
      const message = JSON.parse(new TextDecoder().decode(bytes));
      for (const [key, { type }] of Object.entries(properties)) {
        const found = typeof message[key] === "string" ? "string" : "number";
        const wanted = type === "string" ? "string" : "number";
        if (key in message && found !== wanted) throw new Error(`${schema.name}: ${key} is no ${type}`);
      }
      return message;
    };
  }
  const published = foxgloveMessageSchemas[schema.name.replace("foxglove.", "")];
  const names = new Set(published.fields.map((field) => field.name));
  const type = protobufFromBinaryDescriptor(schema.data).lookupType(schema.name);
  for (const field of type.fieldsArray) {
    const name = field.name.replace(/[A-Z]/g, (letter) => `_${letter.toLowerCase()}`);
    if (!names.has(name)) throw new Error(`${schema.name}: ${name} is not in the published schema`);
  }
  return (bytes) => type.toObject(type.decode(bytes));
}

const decoders = new Map([...reader.schemasById].map(([id, schema]) => [id, decoder(schema)]));
const topics = {};
for (const channel of reader.channelsById.values()) topics[channel.topic] = { messages: 0, fields: [] };
for await (const { channelId, data: bytes } of reader.readMessages()) {
  const channel = reader.channelsById.get(channelId);
  const message = decoders.get(channel.schemaId)(bytes);
  const topic = topics[channel.topic];
  topic.messages += 1;
  topic.fields = [...new Set([...topic.fields, ...Object.keys(message)])];
}
console.log(JSON.stringify(topics));
