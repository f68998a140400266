import { useEffect, useState } from 'preact/hooks';
import { linkTo } from '../state/router.js';
import { exampleOf, nameOfRef, resolve, typeWords, type ApiDocument, type Schema } from './document.js';

export interface SchemaCardProps {
  document: ApiDocument;
  name: string;
  open: boolean;
}

/** One named schema with its keys and an example. */
export function SchemaCard({ document, name, open }: SchemaCardProps) {
  const schema = resolve<Schema>(document, { $ref: `#/components/schemas/${name}` });
  const [shown, setShown] = useState(open);
  useEffect(() => {
    if (open) setShown(true);
  }, [open]);
  return (
    <details class="card route" id={`schema-${name}`} open={shown} onToggle={(event) => setShown(event.currentTarget.open)}>
      <summary><code>{name}</code> <span class="quiet">{schema?.description}</span></summary>
      {shown && schema !== undefined && (
        <div class="route-body">
          {schema.properties === undefined && <p><Type schema={schema} /></p>}
          <Properties schema={schema} />
          <h4>Example</h4>
          <pre tabIndex={0} class="example">{JSON.stringify(exampleOf(document, schema), null, 2)}</pre>
        </div>
      )}
    </details>
  );
}

/** The keys of an object, those within it indented. */
export function Properties({ schema }: { schema: Schema }) {
  const entries = Object.entries(schema.properties ?? {});
  if (entries.length === 0) return null;
  return (
    <ul class="properties">
      {entries.map(([name, property]) => (
        <li key={name}>
          <code>{name}</code>{schema.required?.includes(name) === true && <span class="required" title="required">*</span>}{' '}
          <Type schema={property} /> <span class="words">{property.description}</span>
          <Properties schema={innermost(property)} />
        </li>
      ))}
    </ul>
  );
}

function innermost(schema: Schema): Schema {
  return schema.items === undefined ? schema : innermost(schema.items);
}

/** A schema's type, with a link to the schema that it names. */
export function Type({ schema }: { schema: Schema | undefined }) {
  if (schema?.$ref !== undefined) {
    const name = nameOfRef(schema.$ref);
    return <a class="type" href={linkTo('api', ['schema', name])}>{name}</a>;
  }
  if (schema?.items?.$ref !== undefined) return <span class="type">array of <Type schema={schema.items} /></span>;
  return <span class="type">{typeWords(schema)}</span>;
}
